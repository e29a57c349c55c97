"""LLVM code to machine code, kept on disk from one process to the next."""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm

Kernel = Callable[[int, int, int, int], None]
"""Called with the address of the arguments, the first and the last group of worlds, and the address of a workspace."""

SOURCES = ("compiler", "physics")
"""Packages that machine code is made from."""

DIGEST = hashlib.sha256().digest_size
"""Of the code, in front of it in a file of the cache [bytes]: damaged code is compiled again, and never executed."""

_ENGINES: list[Any] = []  # machine code lives as long as its engine


def load(name: str, write: Callable[[], str]) -> Kernel:
    """Return a compiled function that Python calls (see `address`)."""
    kind = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)
    return kind(address(name, write))


def address(name: str, write: Callable[[], str]) -> int:
    """Return where a compiled function begins in memory.

    Args:
        name: Name of the function, and of its file in the cache.
        write: Returns its LLVM code; called only if no machine code of the same sources for the same processor is kept.
    """
    place = _place(name)
    code = _kept(place)
    if code is None:
        code = _compile(write())
        _keep(place, code)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _ENGINES.append(engine)
    return int(engine.get_function_address(name))


def _compile(code: str) -> bytes:
    module = llvm.parse_assembly(code)
    module.verify()
    return bytes(_target().emit_object(module))


@lru_cache
def _processor() -> tuple[str, str]:
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def _target() -> Any:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    cpu, features = _processor()
    return llvm.Target.from_default_triple().create_target_machine(cpu=cpu, features=features, opt=2, jit=True)


@lru_cache
def _fingerprint() -> str:
    """Return a digest of the sources, the compiler and the processor."""
    digest = hashlib.sha256(repr((llvmlite.__version__, _processor())).encode())
    for path in sorted(path for source in SOURCES for path in (Path(__file__).parents[1] / source).rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _place(name: str) -> Path | None:
    """Return where machine code is kept; None where nobody says: a user without a home, as containers have."""
    roots = (os.environ.get("XDG_CACHE_HOME", ""), os.path.expanduser("~/.cache"))
    # A relative one would mean another place each time.
    root = next((each for each in roots if os.path.isabs(each)), None)
    return None if root is None else Path(root) / "physid" / f"{name}-{_fingerprint()}.o"


def _kept(place: Path | None) -> bytes | None:
    """Return machine code from the cache; None if there is none, or it is not what was written."""
    if place is None:
        return None
    try:
        kept = place.read_bytes()
    except OSError:
        return None
    digest, code = kept[:DIGEST], kept[DIGEST:]
    return code if code and hashlib.sha256(code).digest() == digest else None


def _keep(place: Path | None, code: bytes) -> None:
    """Write to the cache, with a digest; a process that cannot compiles again next time."""
    if place is None:
        return
    draft = place.with_suffix(f".{os.getpid()}")
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        draft.write_bytes(hashlib.sha256(code).digest() + code)
        draft.replace(place)
    except OSError:
        with contextlib.suppress(OSError):
            draft.unlink()
