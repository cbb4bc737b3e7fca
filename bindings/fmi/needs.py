"""What a shared library of Linux needs at run time: libraries, and the version of glibc.

    python3 needs.py LIBRARY [HIGHEST [OTHER...]]    # fails where it needs a later glibc than HIGHEST, or libraries beside it and OTHER
"""

import re
import struct
import sys

#: The parts of glibc.
GLIBC = re.compile(r"lib(c|m|dl|rt|pthread)\.so\.\d|ld-linux.*\.so\.\d")


def needs(content: bytes):
    """The libraries that an ELF file of 64 bits names, and the versions of glibc that its symbols have."""
    if content[:6] != b"\x7fELF\x02\x01":
        raise SystemExit("no ELF file of 64 bits")
    (table,), (size, count) = struct.unpack_from("<Q", content, 0x28), struct.unpack_from("<HH", content, 0x3A)
    sections = [struct.unpack_from("<IIQQQQIIQQ", content, table + i * size) for i in range(count)]

    def text(section, place):
        start = sections[section][4] + place
        return content[start : content.index(b"\0", start)].decode()

    libraries, versions = [], set()
    for _, kind, _, _, offset, length, link, entries, _, _ in sections:
        if kind == 6:  # SHT_DYNAMIC: DT_NEEDED is 1
            pairs = struct.iter_unpack("<QQ", content[offset : offset + length])
            libraries += [text(link, value) for tag, value in pairs if tag == 1]
        if kind == 0x6FFFFFFE:  # SHT_GNU_verneed
            for _ in range(entries):
                _, number, _, first, following = struct.unpack_from("<HHIII", content, offset)
                at = offset + first
                for _ in range(number):
                    _, _, _, name, step = struct.unpack_from("<IHHII", content, at)
                    versions.add(text(link, name))
                    at += step
                offset += following
    found = [tuple(map(int, version[6:].split("."))) for version in versions if re.fullmatch(r"GLIBC_[\d.]+", version)]
    return libraries, max(found, default=(0,))


def main(path: str, highest: str = "", *allowed: str) -> None:
    with open(path, "rb") as file:
        libraries, version = needs(file.read())
    dotted = ".".join(map(str, version))
    print(f"{path}: glibc {dotted}; {' '.join(libraries)}")
    if highest:
        others = [name for name in libraries if not GLIBC.fullmatch(name) and name not in allowed]
        if others or version > tuple(map(int, highest.split("."))):
            raise SystemExit(f"more than glibc {highest}: glibc {dotted} {' '.join(others)}")


if __name__ == "__main__":
    main(*sys.argv[1:])
