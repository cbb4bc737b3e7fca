"""Measures what the tests notice: makes small random errors in the program and counts those that a test catches.

    target/hosts/bin/python tests/mutants.py --seed 1 --count 150

An error (a mutant) is a number five per cent off, an index off by one, an operator or a comparison exchanged, a sign, a statement
or a condition lost, x for y, two fields or arguments exchanged. Mutants are drawn from all places of `src` and of the Rust code of
`bindings`, each place as likely as any other. All of them are compiled at once into a clone of the last commit, each behind a switch that
an environment variable turns on, so there is one build. Each test then runs alone once: how long it takes and which switches it passes
are kept. A mutant is tried by the tests that pass its switch, the short ones first, until one fails or hangs.

Everything is kept in target/mutants/COMMIT-SEED-COUNT: a call for the same commit, seed and count goes on where the last one stopped.
The table of survivors is survivors.md there. `--commit` draws from an earlier commit than the tests are of: survivors are tried again by
tests written since, without a new build of the program. Literals in constants, patterns and macros are not changed; uses of numeric constants are.
With `--longest SECONDS`, tests that alone take longer are left out, so that what is caught is a lower bound.
"""

import argparse
import collections
import concurrent.futures
import json
import math
import os
import random
import re
import resource
import signal
import subprocess
import sys
import threading
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OPERATORS = {
    "+": "-", "-": "+", "*": "/", "/": "*", "<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==",
    "&&": "||", "||": "&&", "%": "/",
}
METHODS = {
    "min": "max", "max": "min", "sin": "cos", "cos": "sin", "first": "last", "last": "first", "any": "all", "all": "any",
    "floor": "ceil", "ceil": "floor", "is_some": "is_none", "is_none": "is_some",
}
DROPPED_METHODS = {"abs", "sqrt", "rev", "recip"}
#: What is of the last commit, whatever commit the mutants are of.
TESTS = ["tests", "bindings/c/tests", "bindings/fmi/tests", "bindings/python/tests"]
#: What never becomes part of an expression that runs.
OUTSIDE = {
    "attribute_item", "inner_attribute_item", "macro_invocation", "macro_definition", "const_item", "static_item",
    "array_type", "match_pattern", "use_declaration", "type_arguments", "type_parameters", "enum_item", "struct_item",
    "const_block", "line_comment", "block_comment", "string_literal", "parameters", "trait_bounds", "where_clause",
}
SWITCHES = r'''//! Switches of mutants: made by tests/mutants.py, never part of the program.
#![allow(missing_docs)]
use std::io::Write as _;
use std::sync::LazyLock;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

static ACTIVE: LazyLock<usize> =
    LazyLock::new(|| std::env::var("CAUDAL_MUTANT").ok().and_then(|id| id.parse().ok()).unwrap_or(usize::MAX));
static PASSED: [AtomicBool; COUNT] = [const { AtomicBool::new(false) }; COUNT];

#[inline]
pub fn is(id: usize) -> bool {
    if !PASSED[id].load(Relaxed) {
        pass(id);
    }
    *ACTIVE == id
}

#[cold]
fn pass(id: usize) {
    PASSED[id].store(true, Relaxed);
    if let Ok(path) = std::env::var("CAUDAL_MUTANTS_PASSED") {
        let file = std::fs::OpenOptions::new().create(true).append(true).open(path);
        if let Ok(mut file) = file {
            let _ = file.write_all(format!("{id}\n").as_bytes());
        }
    }
}

pub trait Nudge {
    #[must_use]
    fn nudge(self) -> Self;
}
impl Nudge for f64 {
    fn nudge(self) -> Self {
        self * 1.05
    }
}
macro_rules! nudge { ($($t:ty)*) => { $(impl Nudge for $t { fn nudge(self) -> Self { self + 1 } })* } }
nudge!(usize u64 u32 u16 u8 i32 i64);
'''


def needed(module):
    """Imports a package that the tests of the project do not need; it is installed where it is missing."""
    try:
        return __import__(module)
    except ImportError:
        subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", module.replace("_", "-")], check=True)
        return __import__(module)


class Source:
    """A file of Rust: the places where it can be changed, and its text with switches."""

    def __init__(self, path, parser):
        self.path, self.text = path, path.read_bytes()
        self.sites = []  # (node, kind, mutated text)
        self.walk(parser.parse(self.text).root_node)

    def raw(self, node):
        return self.text[node.start_byte : node.end_byte].decode()

    def add(self, node, kind, mutated):
        self.sites.append((node, kind, mutated))

    def with_part(self, node, part, text):
        """The text of `node` with `part` of it replaced."""
        whole = self.text[node.start_byte : part.start_byte] + text.encode()
        return (whole + self.text[part.end_byte : node.end_byte]).decode()

    def walk(self, node):
        if node.type in OUTSIDE:
            return
        if node.type == "function_item" and any(c.type == "function_modifiers" and "const" in self.raw(c) for c in node.children):
            return
        if node.type in ("mod_item", "function_item", "impl_item"):
            before = node.prev_named_sibling
            while before is not None and before.type in ("attribute_item", "line_comment"):
                if re.search(r"cfg\((test|windows)|#\[(test|derive)", self.raw(before)):
                    return
                before = before.prev_named_sibling
        self.find(node)
        place = node.type in ("assignment_expression", "compound_assignment_expr")
        for index, child in enumerate(node.children):
            name = node.field_name_for_child(index)
            if place and name == "left":
                continue
            if name in ("pattern", "type", "return_type", "trait", "length", "type_arguments"):
                continue
            self.walk(child)

    def find(self, node):
        kind, parent = node.type, node.parent
        if kind == "float_literal":
            number = self.raw(node).replace("_", "")
            if re.fullmatch(r"[0-9.eE+-]+", number):
                value = float(number)
                self.add(node, "number", repr(value * 1.05 if value else 0.05))
        elif kind == "integer_literal" and parent.type != "field_expression" and re.fullmatch(r"[0-9]+", self.raw(node)):
            self.add(node, "integer", str(int(self.raw(node)) + 1))
        elif kind == "boolean_literal":
            self.add(node, "boolean", "false" if self.raw(node) == "true" else "true")
        elif kind in ("identifier", "scoped_identifier") and parent.type not in ("scoped_identifier", "call_expression", "field_initializer"):
            if re.fullmatch(r"(\w+::)*[A-Z][A-Z0-9_]+", self.raw(node)):
                self.add(node, "constant", f"NUDGE({self.raw(node)})")
        elif kind == "binary_expression":
            operator = node.child_by_field_name("operator")
            if (other := OPERATORS.get(self.raw(operator))) is not None:
                self.add(node, f"{self.raw(operator)} for {other}", self.with_part(node, operator, other))
        elif kind == "compound_assignment_expr":
            operator = node.child_by_field_name("operator")
            other = OPERATORS.get(self.raw(operator)[:-1])
            if other in {"+", "-", "*", "/"}:
                self.add(node, f"{self.raw(operator)} for {other}=", self.with_part(node, operator, other + "="))
            self.add(node, "dropped", "()")
        elif kind == "unary_expression":
            self.add(node, f"{self.raw(node)[0]} dropped", self.raw(node)[1:])
        elif kind == "if_expression":
            condition = node.child_by_field_name("condition")
            if "let " not in self.raw(condition):
                self.add(condition, "negated", f"!({self.raw(condition)})")
        elif kind == "expression_statement":
            call = node.named_children[0] if node.named_children else None
            if call is not None and call.type == "call_expression" and self.raw(node).endswith(";"):
                self.add(call, "dropped", "()")
        elif kind == "field_expression":
            name = node.child_by_field_name("field")
            swapped = {"x": "y", "y": "x", "0": "1", "1": "0"}.get(self.raw(name))
            reference = parent.type in ("reference_expression", "assignment_expression", "compound_assignment_expr")
            called = parent.type == "call_expression" and parent.child_by_field_name("function") == node
            if swapped and not reference and not called:
                self.add(node, f".{self.raw(name)} for .{swapped}", self.with_part(node, name, swapped))
        elif kind == "call_expression":
            function = node.child_by_field_name("function")
            if function.type == "field_expression":
                name = function.child_by_field_name("field")
                if (other := METHODS.get(self.raw(name))) is not None:
                    self.add(node, f"{self.raw(name)} for {other}", self.with_part(node, name, other))
                elif self.raw(name) in DROPPED_METHODS:
                    self.add(node, f"{self.raw(name)} dropped", self.raw(function.child_by_field_name("value")))
            arguments = [c for c in node.child_by_field_name("arguments").named_children if "comment" not in c.type]
            if any(c.type == "attribute_item" for c in arguments):
                return
            for a, b in zip(arguments, arguments[1:]):
                if self.raw(a) != self.raw(b):
                    mutated = (self.text[node.start_byte : a.start_byte] + self.text[b.start_byte : b.end_byte]
                               + self.text[a.end_byte : b.start_byte] + self.text[a.start_byte : a.end_byte]
                               + self.text[b.end_byte : node.end_byte])
                    self.add(node, "arguments exchanged", mutated.decode())
        elif kind == "field_initializer_list":
            fields = [c for c in node.named_children if c.type == "field_initializer"]
            for a, b in zip(fields, fields[1:]):
                a, b = a.child_by_field_name("value"), b.child_by_field_name("value")
                if self.raw(a) != self.raw(b):
                    self.add(a, "fields exchanged", (b, self.raw(a), self.raw(b)))

    def switched(self, mutants, module):
        """The text with the switches of `mutants`, (id, site) of this file."""
        edits = collections.defaultdict(list)  # (start, end) → [(id, mutated)]
        for id, (node, _, mutated) in mutants:
            if isinstance(mutated, tuple):
                other, first, second = mutated
                edits[node.start_byte, -node.end_byte].append((id, second))
                edits[other.start_byte, -other.end_byte].append((id, first))
            else:
                edits[node.start_byte, -node.end_byte].append((id, mutated))
        order = sorted(edits)

        def render(start, end, index):
            out = b""
            while index < len(order) and order[index][0] < end:
                first, last = order[index][0], -order[index][1]
                out += self.text[start:first]
                inner, index_after = render(first, last, index + 1)
                for id, mutated in edits[order[index]]:
                    if mutated == "()":
                        inner = f"(if !{module}::mutant::is({id}) {{ ".encode() + inner + b"; })"
                        continue
                    mutated = re.sub(r"^NUDGE\((.*)\)$", rf"{module}::mutant::Nudge::nudge(\1)", mutated)
                    inner = f"(if {module}::mutant::is({id}) {{ {mutated} }} else {{ ".encode() + inner + b" })"
                out, start, index = out + inner, last, index_after
            return out + self.text[start:end], index

        return render(0, len(self.text), 0)[0]


#: The clone with the switches: one for all draws, as what is built in another folder is built anew.
TREE = ROOT / "target/mutants/tree"
#: Which draw its switches are of.
DRAWN = TREE / "target/drawn.txt"


def git(*arguments):
    return subprocess.run(["git", "-C", str(TREE), *arguments], capture_output=True, text=True, check=True).stdout


def clone(commit):
    if not TREE.exists():
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(TREE)], check=True)
        (TREE / "target").mkdir()
        (TREE / "target/hosts").symlink_to(ROOT / "target/hosts")
    DRAWN.unlink(missing_ok=True)
    git("fetch", "--quiet", "origin")
    git("checkout", "--quiet", "--force", "--detach", commit)
    return TREE


def sources(tree):
    import tree_sitter_rust
    from tree_sitter import Language, Parser

    parser = Parser(Language(tree_sitter_rust.language()))
    paths = sorted(tree.glob("src/**/*.rs")) + sorted(tree.glob("bindings/*/src/**/*.rs"))
    return [Source(path, parser) for path in paths if path.name != "mutant.rs"]


def module_of(tree, path):
    path = path.relative_to(tree)
    own = path.parts[0] == "src" and path.parts[1] not in ("cli", "main.rs")
    return "crate" if own else "caudal"


def written(spans):
    """The spans of an error, and for those within a macro also where it is called."""
    for span in spans:
        while span:
            yield span
            span = (span["expansion"] or {}).get("span")


def instrument(folder, commit, seed, count):
    """Draws mutants, leaves out those that do not compile, and writes `count` of them, with their switches, into the clone."""
    kept = folder / "mutants.json"
    tree = clone(commit)
    files = sources(tree)
    every = [(file, site) for file in files for site in file.sites]
    print(f"{len(every)} places", flush=True)
    drawn = random.Random(seed).sample(every, int(1.6 * count))
    known = json.loads(kept.read_text()) if kept.exists() else None
    alive = [mutant["id"] for mutant in known] if known else list(range(len(drawn)))
    while True:
        chosen = alive[:count]
        switches = SWITCHES.replace("COUNT", str(len(drawn)))
        (tree / "src/mutant.rs").write_text(switches)
        spans = {}
        for file in files:
            mine = [(id, drawn[id][1]) for id in chosen if drawn[id][0] is file]
            text = file.switched(mine, module_of(tree, file.path)).decode()
            if file.path == tree / "src/lib.rs":
                text = text.replace("pub use nalgebra;", "pub mod mutant;\npub use nalgebra;")
            text = re.sub(r"deny\((warnings|unused[^)]*)\)", r"warn(\1)", text)
            if file.path.read_text() != text:
                file.path.write_text(text)
            for number, line in enumerate(text.splitlines(), 1):
                for id in re.findall(r"mutant::is\((\d+)\)", line):
                    spans.setdefault((str(file.path.relative_to(tree)), number), set()).add(int(id))
        if known:
            DRAWN.write_text(folder.name)
            return known
        built = subprocess.run(
            ["cargo", "check", "--workspace", "--message-format=json"], cwd=tree, capture_output=True, text=True
        )
        bad = set()
        for line in built.stdout.splitlines():
            message = json.loads(line).get("message") or {}
            if message.get("level") != "error":
                continue
            found = set()
            todo = [message]
            while todo:
                part = todo.pop()
                todo += part.get("children", [])
                for span in written(part["spans"]):
                    for number in range(span["line_start"], span["line_end"] + 1):
                        found |= spans.get((span["file_name"], number), set())
            if not found:
                # Within a mutated text of several lines: its switch is the last one before.
                for span in written(message["spans"]):
                    before = [n for file, n in spans if file == span["file_name"] and n <= span["line_start"]]
                    found |= spans[span["file_name"], max(before)] if before else set()
            bad |= found
        print(f"{len(chosen)} mutants, {len(bad)} of them do not compile", flush=True)
        if built.returncode == 0:
            break
        if not bad:
            sys.exit(built.stderr)
        alive = [id for id in alive if id not in bad]
    mutants = []
    for id in chosen:
        file, (node, kind, mutated) = drawn[id]
        changed = mutated if isinstance(mutated, str) else f"{mutated[2]} for {mutated[1]}"
        mutants.append({
            "id": id, "file": str(file.path.relative_to(tree)), "line": node.start_point[0] + 1, "kind": kind,
            "was": " ".join(file.raw(node).split())[:90], "is": " ".join(changed.split())[:90],
        })
    kept.write_text(json.dumps(mutants, indent=1))
    DRAWN.write_text(folder.name)
    return mutants


class Test:
    """A test that runs alone: one function of Rust or one file of Python."""

    def __init__(self, name, command, cwd):
        self.name, self.command, self.cwd = name, command, cwd

    def run(self, limit, **variables):
        """Whether it passed, and how long it took; None where it was cut off. Both times are of the processor, whatever else runs beside
        it; what waits for nothing is cut off after ten times as long, and some."""
        processor = math.ceil(limit)
        process = subprocess.Popen(
            self.command, cwd=self.cwd, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
            env=os.environ | {"CAUDAL_RANDOM_CALLS": "200"} | variables,
        )
        resource.prlimit(process.pid, resource.RLIMIT_CPU, (processor, processor))
        stuck = threading.Timer(60 + 10 * limit, lambda: os.killpg(process.pid, 9))
        stuck.start()
        _, status, usage = os.wait4(process.pid, 0)
        stuck.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        try:
            os.killpg(process.pid, 9)
        except ProcessLookupError:
            pass
        cut = process.returncode in (-signal.SIGKILL, -signal.SIGXCPU)
        return None if cut else process.returncode == 0, usage.ru_utime + usage.ru_stime


def tests(folder, python_too):
    """All tests, those of the last commit, built with the switches."""
    tree = TREE
    git("checkout", "--quiet", "--force", subprocess.run(
        ["git", "-C", str(ROOT), "rev-parse", "HEAD"], capture_output=True, text=True, check=True).stdout.strip(), "--", *TESTS)
    built = subprocess.run(
        ["cargo", "test", "--workspace", "--no-run", "--message-format=json"], cwd=tree, stdout=subprocess.PIPE, text=True, check=True
    )
    found = []
    for line in built.stdout.splitlines():
        message = json.loads(line)
        if message.get("executable") and message["profile"]["test"] and "bench" not in message["target"]["kind"]:
            binary, cwd = message["executable"], Path(message["manifest_path"]).parent
            listed = subprocess.run([binary, "--list", "--format", "terse"], capture_output=True, text=True, cwd=cwd).stdout
            for name in re.findall(r"^(.*): test$", listed, re.M):
                found.append(Test(f"{message['target']['name']}::{name}", [binary, "--exact", name], cwd))
    if python_too:
        venv, hosts = TREE.parent / "venv", tree / "target/hosts"
        python = venv / "bin/python"
        if not python.exists():
            subprocess.run([hosts / "bin/python", "-m", "venv", "--without-pip", venv], check=True)
            packages = next(venv.glob("lib/python*/site-packages"))
            (packages / "hosts.pth").write_text(f"{next(hosts.glob('lib/python*/site-packages'))}\n")
        subprocess.run(
            [hosts / "bin/python", "-m", "pip", "--python", python, "install", "--quiet", "--no-deps", "--force-reinstall",
             "./bindings/python"],
            cwd=tree, env=os.environ | {"CAUDAL_PROFILE": "dev"}, check=True,
        )
        for path in sorted([*tree.glob("bindings/python/tests/test_*.py"), *tree.glob("bindings/*/examples/**/test_*.py")]):
            name = str(path.relative_to(tree))
            found.append(Test(name, [python, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", name], tree))
    return found


def measure(folder, found, jobs, longest):
    """How long each test takes without a mutant, and which switches it passes."""
    kept = folder / "tests.json"
    known = json.loads(kept.read_text()) if kept.exists() else {}

    def one(test):
        passed = folder / f"passed-{abs(hash(test.name))}.txt"
        passed.unlink(missing_ok=True)
        good, seconds = test.run(longest, CAUDAL_MUTANTS_PASSED=str(passed))
        ids = sorted({int(id) for id in passed.read_text().split()}) if passed.exists() else []
        passed.unlink(missing_ok=True)
        return test.name, {"passes": good, "seconds": round(seconds, 3), "ids": ids}

    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        for name, result in pool.map(one, [test for test in found if test.name not in known]):
            known[name] = result
            kept.write_text(json.dumps(known))
            if not result["passes"]:
                why = f"takes longer than {longest:g} s" if result["passes"] is None else "fails without a mutant"
                print(f"left out, it {why}: {name}", flush=True)
    return known


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=150)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--without-python", action="store_true", help="leave the tests of the Python package out")
    parser.add_argument("--longest", type=float, default=900, metavar="SECONDS", help="leave tests that take longer out")
    parser.add_argument("--only", type=int, nargs="+", help="try these mutants again")
    parser.add_argument("--survivors", action="store_true", help="try those that lived again, by tests that have changed since")
    parser.add_argument("--commit", default="HEAD", help="draw from this commit")
    options = parser.parse_args()
    needed("tree_sitter")
    needed("tree_sitter_rust")
    commit = subprocess.run(["git", "-C", str(ROOT), "rev-parse", "--short", options.commit], capture_output=True, text=True, check=True).stdout.strip()
    folder = ROOT / f"target/mutants/{commit}-{options.seed}-{options.count}"
    folder.mkdir(parents=True, exist_ok=True)
    if DRAWN.exists() and DRAWN.read_text() == folder.name:
        mutants = json.loads((folder / "mutants.json").read_text())
    else:
        mutants = instrument(folder, commit, options.seed, options.count)
    found = tests(folder, not options.without_python)
    known = measure(folder, found, options.jobs, options.longest)
    results_file = folder / "results.json"
    results = json.loads(results_file.read_text()) if results_file.exists() else {}
    lived = [int(id) for id, result in results.items() if not result["caught"]] if options.survivors else []
    for id in (options.only or []) + lived:
        results.pop(str(id), None)

    def one(mutant):
        passing = [t for t in found if known[t.name]["passes"] and mutant["id"] in known[t.name]["ids"]]
        passing.sort(key=lambda test: known[test.name]["seconds"])
        for test in passing:
            seconds = known[test.name]["seconds"]
            good, _ = test.run(20 + 8 * seconds, CAUDAL_MUTANT=str(mutant["id"]))
            if not good:
                return mutant, {"caught": test.name, "how": "hangs" if good is None else "fails"}
        return mutant, {"caught": None, "passed by": [test.name for test in passing]}

    todo = [m for m in mutants if str(m["id"]) not in results and (not options.only or m["id"] in options.only)]
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        for future in concurrent.futures.as_completed([pool.submit(one, mutant) for mutant in todo]):
            mutant, result = future.result()
            results[str(mutant["id"])] = result
            results_file.write_text(json.dumps(results, indent=1))
            print(f"{mutant['file']}:{mutant['line']} {mutant['kind']}: {result['caught'] or 'SURVIVED'}", flush=True)
    rows = [m for m in mutants if not results[str(m["id"])]["caught"]]
    lines = [f"{len(mutants) - len(rows)} of {len(mutants)} mutants caught, commit {commit}, seed {options.seed}", "",
             "| place | was | is | tests that pass it |", "|---|---|---|---|"]
    for m in rows:
        by = len(results[str(m["id"])]["passed by"])
        lines.append(f"| {m['file']}:{m['line']} | `{m['was']}` | `{m['is']}` ({m['kind']}) | {by} |".replace("||", "\\|\\|"))
    (folder / "survivors.md").write_text("\n".join(lines) + "\n")
    print(lines[0])


if __name__ == "__main__":
    main()
