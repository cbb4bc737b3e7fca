"""Both ways to run a sweep under Slurm, where there is one (one_node_slurm.sh makes one of this machine)."""

import shutil
import subprocess
import sys
import textwrap

import pytest
from test_engines import make_sweep, results, rows_of_journal

import caudal


@pytest.fixture(autouse=True)
def slurm():
    """Skips where no Slurm answers."""
    there = shutil.which("sbatch") and subprocess.run(["sinfo"], capture_output=True).returncode == 0
    if not there:
        pytest.skip(
            "sweeps under Slurm: as root, apt-get install slurm-wlm, then sh bindings/python/tests/one_node_slurm.sh sh tests/all.sh"
        )


def submit(script, folder, *options):
    """Waits for a job; what it printed."""
    path = folder / "job.sh"
    path.write_text("#!/bin/sh\nset -eu\n" + textwrap.dedent(script))
    output = folder / "job-%a.txt"
    subprocess.run(["sbatch", "--wait", "--quiet", f"--output={output}", *options, path], cwd=folder, timeout=300, check=True)


def test_workers_that_srun_starts_in_one_allocation_give_our_results_to_the_bit(tmp_path):
    pytest.importorskip("distributed")
    sweep = make_sweep(tmp_path, count=20, duration=2.0)
    caudal.sweep(sweep, out=tmp_path / "ours")
    client = f"""
    import caudal
    from distributed import Client
    with Client(scheduler_file="s.json", timeout=60) as client:
        client.wait_for_workers(2, timeout=60)
        caudal.sweep({str(sweep)!r}, out="out", client=client)
        client.shutdown()
    """
    (tmp_path / "client.py").write_text(textwrap.dedent(client))
    python = sys.executable
    submit(
        f"""
        {python} -m dask scheduler --host 127.0.0.1 --port 0 --no-dashboard --scheduler-file s.json &
        srun {python} -m dask worker --scheduler-file s.json --nthreads 1 --no-dashboard &
        {python} client.py
        wait
        """,
        tmp_path,
        "--ntasks=2",
    )
    assert rows_of_journal(tmp_path / "out") == rows_of_journal(tmp_path / "ours")
    assert results(tmp_path / "out") == results(tmp_path / "ours")


def test_an_array_job_of_shards_that_are_merged_gives_our_results_to_the_bit(command, tmp_path):
    sweep = make_sweep(tmp_path, count=20, duration=2.0)
    caudal.sweep(sweep, out=tmp_path / "ours")
    caudal_command = shutil.which("caudal", path=str(sys.executable).rpartition("/")[0])
    shard = "--shard $SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT"
    submit(f"{caudal_command} sweep {sweep} --out {tmp_path}/out {shard}\n", tmp_path, "--array=1-4")
    command(None, "sweep", "merge", sweep, "--out", tmp_path / "out")
    assert results(tmp_path / "out") == results(tmp_path / "ours")
