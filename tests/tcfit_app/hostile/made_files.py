"""Hostile files by the hundred, made from a seed: what works with something wrong in it, and what no program writes.

Each function writes files into a folder of its own, and returns the command line that reads them, or `UPLOAD`.
"""

import bz2
import gzip
import io
import lzma
import pickle
import pickletools
import re
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.fitting_core.io.cameras import camera_files
from tests.fitting_core.io.malformed import FAR_MEMO, HOSTILE, endless_npz, zipped
from tests.fitting_core.io.motion.learned_files import gvhmr, joblib_bytes, npz_bytes, torch_bytes, truth, wham
from tests.samples.body_files import body_arrays
from tests.tcfit_app.conftest import QUICK
from tests.tcfit_app.hostile.calls import UPLOAD

Rng = np.random.Generator
Make = Callable[[Rng, Path], list[str]]
EXECUTED = "executed"
"""The file that a pickle makes if anything of it is run."""
_CLIP = ["walk.mp4", "--keypoints", "keypoints"]


def one(rng: Rng, choices: Any) -> Any:
    """One of some things."""
    choices = list(choices)
    return choices[rng.integers(len(choices))]


# --- pickles ---

_RUN = f"touch {EXECUTED}".encode()
_CODES: tuple[Callable[[int], bytes], ...] = (
    lambda n: b"cos\nsystem\n(S'" + _RUN + b"'\ntR",
    lambda n: b"(S'" + _RUN + b"'\nios\nsystem\n",
    lambda n: b"(cos\nsystem\nS'" + _RUN + b"'\no",
    lambda n: b"\x8c\x08builtins\x8c\x04exec\x93\x8c\x26import os;os.system('touch executed')#12345\x85R",
    lambda n: b"\x8c\x0boperator\x8c\x0amethodcaller\x93\x8c\x06system\x85R",
    lambda n: b"cbuiltins\ngetattr\n(cnumpy\nndarray\nS'__class__'\ntR",
    lambda n: b"K\x00K\x00\x86" + b"2\x86" * (n % 200),
    lambda n: b")" + b"\x85" * n,
    lambda n: b"]" * n,
    lambda n: b"(" * n,
    lambda n: b"(" * n + b"l" * (n // 2),
    lambda n: b"]" + b"]a" * 5 + b"2a" * (n % 1000),
    lambda n: b"]\x94" + b"h\x00a" * (n % 1000),
    lambda n: b"}\x94\x8c\x01a\x68\x00s" * (n % 1000),
    lambda n: b"}}\x8c\x08__dict__}sb",
    lambda n: b"\x8c\x0bcollections\x8c\x0bOrderedDict\x93)R}\x8c\x07__class__\x8c\x05numpy\x8c\x07ndarray\x93sb",
    lambda n: b"cnumpy\nndarray\n)\x81(K\x01(K\xffK\xff\x86cnumpy\ndtype\n(S'f8'\ntR\x89S'x'\ntb",
    lambda n: b"cnumpy.core.multiarray\nscalar\n(cnumpy\ndtype\n(S'V999999999'\ntRS'x'\ntR",
    lambda n: b"Nr" + struct.pack("<I", n * 1000),
    lambda n: b"Nq\xff" * n,
    lambda n: b"\x94" * n,
    lambda n: b"j" + struct.pack("<I", n),
    lambda n: b"\x82" + bytes([n % 256]),
    lambda n: b"P" + b"x" * n + b"\n",
    lambda n: b"NQ",
    lambda n: b"\x96" + struct.pack("<Q", n << 20),
    lambda n: b"\x8e" + struct.pack("<Q", 2**62 + n),
    lambda n: b"B" + struct.pack("<I", 2**31 - 1),
    lambda n: b"\x8b" + struct.pack("<i", -n),
    lambda n: b"\x8b" + struct.pack("<i", n) + b"\x7f" * n,
    lambda n: b"I" + b"9" * n + b"\n",
    lambda n: b"L" + b"9" * n + b"L\n",
    lambda n: b"F1e" + b"9" * (n % 1000) + b"\n",
    lambda n: b"S'" + b"\\x00" * n + b"\n",
    lambda n: b"V" + b"\\ud800" * n + b"\n",
    lambda n: b"\x95" + struct.pack("<Q", n << 10),
    lambda n: b"\x97\x98",
    lambda n: b"\x80" + bytes([n % 256]),
    lambda n: b"0" * n,
    lambda n: b"\x8f(" + b"K\x00K\x00\x86" + b"2\x86" * 40 + b"\x90",
    lambda n: FAR_MEMO[2:-1],
)
"""Codes that may stand anywhere in a pickle, of a size."""


def mutated(rng: Rng, data: bytes) -> bytes:
    """A pickle with some of its codes changed, repeated, left out, or with others between them."""
    for _ in range(rng.integers(1, 4)):
        try:
            places = [place for _, _, place in pickletools.genops(data) if place is not None]
        except Exception:
            places = list(range(min(len(data), 4000)))
        start, end = sorted(int(one(rng, places[-400:] + places[:400])) for _ in range(2))
        size = int(10 ** rng.uniform(0, 6))
        data = one(
            rng,
            (
                data[:start] + bytes([rng.integers(256)]) + data[start + 1 :],
                data[:start] + data[end:],
                data[:end] + data[start:end] * min(size, 10**6 // (end - start + 1)) + data[end:],
                data[:start] + one(rng, _CODES)(size) + data[start:],
                data[:start] + one(rng, _CODES)(size) + data[end:],
                data[:start],
            ),
        )
    return data


_PACKED: tuple[Callable[[bytes], bytes], ...] = (
    bytes,
    bytes,
    gzip.compress,
    zlib.compress,
    bz2.compress,
    lzma.compress,
)


def pickles(rng: Rng, folder: Path) -> list[str]:
    """Results and bodies."""
    people, protocol = {1: (truth(), np.arange(5))}, int(rng.integers(0, 6))
    seeds = (
        lambda: pickle.dumps(wham(people), protocol),
        lambda: joblib_bytes(wham(people), protocol=max(protocol, 2)),
        lambda: pickle.dumps(body_arrays(), protocol),
        lambda: one(rng, [data for data, _ in HOSTILE.values() if len(data) < 2**22]),
    )
    data = mutated(rng, one(rng, seeds)())
    kind = one(rng, ("pkl", "pkl", "pkl", "body", "body", "torch", "npz", "smplifyx"))
    if kind == "body":
        (folder / "SMPLX_NEUTRAL.pkl").write_bytes(data)
        return one(
            rng,
            (
                ["models", "add", str(folder / "SMPLX_NEUTRAL.pkl")],
                ["fit", *_CLIP, "--out", "new", "--body-model", str(folder / "SMPLX_NEUTRAL.pkl"), *QUICK],
            ),
        )
    path = folder / {"pkl": "a.pkl", "torch": "a.pt", "npz": "a.npz", "smplifyx": "a.zip"}[kind]
    if kind == "pkl":
        data = one(rng, _PACKED)(data)
    elif kind == "torch":
        with zipfile.ZipFile(io.BytesIO(torch_bytes(gvhmr(truth())))) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        name = next(name for name in members if name.endswith("data.pkl"))
        data = zipped(members | {name: mutated(rng, members[name]) if rng.random() < 0.7 else data})
    elif kind == "npz":
        with zipfile.ZipFile(io.BytesIO(npz_bytes(results={"a": [1.0]}, poses=[None]))) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        head = members["results.npy"].index(b"\n") + 1
        data = zipped(members | {"results.npy": members["results.npy"][:head] + data})
    else:
        data = zipped({"results/f0000/000.pkl": data})
    path.write_bytes(data)
    return one(rng, (["import", "walk.tcfit", str(path), "--body-model", "smplx"], [UPLOAD, "walk.tcfit", str(path)]))


# --- cameras ---

_CAMERAS: dict[str, Callable[[Path], Path]] = {
    "a.toml": camera_files.pose2sim, "b.toml": camera_files.caliscope, "a.yml": camera_files.opencv,
    "a.xml": camera_files.opencv, "a.json": camera_files.opencv, "a.yaml": camera_files.ros,
    "b.json": camera_files.plain_json, "transforms.json": camera_files.transforms,
}  # fmt: skip
_VALUES: tuple[Callable[[int], str], ...] = (
    lambda n: one(np.random.default_rng(n), ("1e400", "-1e400", "nan", ".nan", ".inf", "-inf", "NaN", "Infinity")),
    lambda n: one(np.random.default_rng(n), ("[]", "{}", "null", "true", '""', "~", "'", '"', "\x00", "\ufeff", "<")),
    lambda n: one(np.random.default_rng(n), ("1e308", "-1e308", "1e-320", "0", "-1", "2147483648", "0x7fffffff")),
    lambda n: "9" * n,
    lambda n: "[" * n + "]" * n,
    lambda n: '{"a":' * n + "1" + "}" * n,
    lambda n: "<a>" * n + "</a>" * n,
    lambda n: "1, " * n + "1",
    lambda n: "x" * n,
    lambda n: "a." * n + "a = 1\n",
    lambda n: "- " * n,
    lambda n: "\n" + " " * (n % 5000) + "a:",
    lambda n: "!!python/object/apply:os.system ['touch executed']",
    lambda n: '"!!' + "x" * n + '"',
    lambda n: "!!opencv-matrix\n   rows: 2000000000\n   cols: 2000000000\n   dt: d\n   data: [1]",
    lambda n: "\n".join([f"k{i}: &k{i} [{', '.join([f'*k{i - 1}'] * 9) if i else '1'}]" for i in range(9)]),
    lambda n: (
        "<!DOCTYPE a [<!ENTITY a0 'x'>"
        + "".join(f"<!ENTITY a{i} '{f'&a{i - 1};' * 10}'>" for i in range(1, 10))
        + "]><b>&a9;</b>"
    ),
    lambda n: "<!DOCTYPE a [<!ENTITY a SYSTEM 'file:///etc/passwd'>]><b>&a;</b>",
)
"""What may stand for a number or between two lines, of a size."""


def cameras(rng: Rng, folder: Path) -> list[str]:
    """Camera files."""
    path = one(rng, _CAMERAS.items())
    path = path[1](folder / path[0])
    text = path.read_text()
    for _ in range(rng.integers(1, 4)):
        size = int(10 ** rng.uniform(0, 5.3))
        pattern = one(rng, (r"-?\d+(\.\d+)?(e-?\d+)?", r"-?\d+(\.\d+)?(e-?\d+)?", r"\n", r"\w+", r"\[.*?\]"))
        places = [match.span() for match in re.finditer(pattern, text[:50_000])] or [(0, 0)]
        start, end = one(rng, places)
        new = one(rng, _VALUES)(size)
        text = one(rng, (text[:start] + new + text[end:], text[:start] + new + text[start:], text[:start]))
    encoded = text.encode(one(rng, ["utf-8"] * 9 + ["utf-16", "latin-1"]), "replace")
    path.write_bytes(encoded[: 2**24])
    return ["new", *_CLIP, "--out", "new.tcfit", "--camera", str(path)]


# --- more memory than a file has ---

_ZEROS = bytes(2**26)


def _many_times(packed: bytes) -> bytes:
    """Streams of 64 MB behind each other."""
    return packed * 40


def _shape(rng: Rng) -> tuple[int, ...]:
    return tuple(int(10 ** rng.uniform(0, 12)) for _ in range(rng.integers(1, 5)))


def _declared_npz(rng: Rng) -> bytes:
    members = {}
    for name in ("poses", "trans", "betas", "K", "R", "t", "v_template", "points", "results", "pred_cam"):
        header = io.BytesIO()
        declared = {"descr": one(rng, ("<f8", "|u1", "<U99999999", "|O", "<f4")), "fortran_order": False}
        np.lib.format.write_array_header_2_0(header, {**declared, "shape": _shape(rng)})
        members[f"{name}.npy"] = header.getvalue() + bytes(int(rng.integers(99)))
    return zipped(members)


def _deflated(rng: Rng) -> bytes:
    file = io.BytesIO()
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (5 * 2**23, 5)})
    name = f"{one(rng, ('poses', 'K', 'v_template'))}.npy"
    with (
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open(name, "w", force_zip64=True) as member,
    ):
        member.write(header.getvalue())
        for _ in range(25):
            member.write(_ZEROS)
    return file.getvalue()


def _c3d(rng: Rng) -> bytes:
    words = rng.integers(0, 2**16, 256).astype("<u2")
    words[:1] = 0x5002
    return words.tobytes() + bytes([0, 0, int(rng.integers(256)), 84]) + rng.bytes(2000)


def _trc(rng: Rng) -> bytes:
    many = int(10 ** rng.uniform(2, 12))
    wide = "\t".join(f"M{i}" for i in range(min(many, 10**6)))
    rows = "1\t0.1\t0.2\n" * int(10 ** rng.uniform(0, 5))
    head = "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tNumFrames\tNumMarkers\tUnits\n"
    return f"{head}120\t{many}\t{one(rng, (1, many))}\tm\nFrame#\tTime\t{wide}\n\n{rows}".encode()


def _eaf(rng: Rng) -> bytes:
    many = int(10 ** rng.uniform(2, 5.3))
    inner = one(
        rng,
        (
            "<TIER>" * many,
            "<TIME_ORDER>" + "<TIME_SLOT TIME_SLOT_ID='a' TIME_VALUE='1'/>" * many + "</TIME_ORDER>",
            f"<TIER TIER_ID='{'x' * 10 * many}'/>",
            "<TIER " + " ".join(f"a{i}='1'" for i in range(many)) + "/>",
        ),
    )
    bomb = "".join(f"<!ENTITY a{i} '{f'&a{i - 1};' * 10}'>" for i in range(1, 10))
    start = one(rng, ("", f"<!DOCTYPE a [<!ENTITY a0 'x'>{bomb}]>"))
    return f"<?xml version='1.0'?>{start}<ANNOTATION_DOCUMENT>{inner}&a9;</ANNOTATION_DOCUMENT>".encode()


def _tar(rng: Rng) -> bytes:
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w:gz") as archive:
        for number in range(int(10 ** rng.uniform(0, 3))):
            member = tarfile.TarInfo(one(rng, (f"results/f{number}/000.pkl", "../../out", "/etc/x", "a" * 200)))
            member.type = one(
                rng, (tarfile.REGTYPE, tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE, tarfile.CHRTYPE)
            )
            member.linkname, member.size = "/etc/passwd", 100 if member.type == tarfile.REGTYPE else 0
            archive.addfile(member, io.BytesIO(bytes(100)))
    return one(
        rng, (file.getvalue(), gzip.compress(bytes(257) + b"99999999999\0" + bytes(9000)), _many_times(_PACKED_ZEROS))
    )


_PACKED_ZEROS = gzip.compress(_ZEROS, 1)
_XZ_ZEROS = lzma.compress(_ZEROS, preset=0)
_BOMBS: dict[str, Callable[[Rng], bytes]] = {
    "a.npz": _declared_npz, "b.npz": _deflated, "c.npz": lambda rng: endless_npz(one(rng, ("poses", "K", "betas"))),
    "SMPLX_MALE.npz": lambda rng: one(rng, (_declared_npz, _deflated))(rng),
    "a.pkl": lambda rng: _many_times(one(rng, (_PACKED_ZEROS, _XZ_ZEROS))),
    "b.pkl": lambda rng: zlib.compress(b"\x80\x04}(" + b"K\x00]" * int(10 ** rng.uniform(5, 7.3)) + b"u."),
    "c.pkl": lambda rng: b"\x80\x04" + one(rng, (b"]", b"}", b")\x85", b"\x8c\x01a", b"N\x94")) * 10**7 + b".",
    "a.toml": lambda rng: (".".join("a" * int(10 ** rng.uniform(2, 5.3))) + " = 1\n").encode(),
    "b.toml": lambda rng: b"a = " + b"[" * int(10 ** rng.uniform(2, 6)),
    "a.json": lambda rng: b"[" * int(10 ** rng.uniform(2, 7)),
    "a.c3d": _c3d, "a.trc": _trc, "a.eaf": _eaf, "a.tar.gz": _tar,
}  # fmt: skip


def bombs(rng: Rng, folder: Path) -> list[str]:
    """Files that say, or hold when they are unpacked, much more than they are."""
    name, make = one(rng, _BOMBS.items())
    path = folder / name
    path.write_bytes(make(rng))
    read: list[list[str]] = [["import", "walk.tcfit", str(path)]]
    if path.suffix in (".npz", ".c3d", ".trc"):
        read.append(["evaluate", "result", "--reference", str(path), "--out", "new"])
    if path.suffix in (".npz", ".toml", ".json"):
        read.append(["new", *_CLIP, "--out", "new.tcfit", "--camera", str(path)])
    if path.suffix == ".toml":
        read += [["settings", "--config", str(path)]] * 2
    if path.stem.startswith("SMPLX"):
        read = [["models", "add", str(path)], ["fit", *_CLIP, "--out", "new", "--body-model", str(path), *QUICK]]
    if path.suffix in (".npz", ".pkl"):
        read.append([UPLOAD, "walk.tcfit", str(path)])
    return one(rng, read)
