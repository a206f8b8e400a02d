"""Untrusted zip archives: members, sizes, types and shapes are checked before anything is unpacked.

An archive of 2 MB can hold 2 GB of zeros. Its directory says how large each member is, and the header of an array says
its type and shape: both are compared with what the reader expects, and no more than that is unpacked.
"""

import math
import os
import struct
import zipfile
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import IO

import numpy as np
from numpy.lib import format as npy

from gcs.types import AnyArray
from gcs.util.bounded_file import MIB, in_mib

_END = struct.Struct("<4s4H2IH")  # the record at the end of an archive
_END_MARK, _ZIP64_MARK = b"PK\x05\x06", b"PK\x06\x07"
_ZIP64_BYTES = 20
_ENTRIES_MAX = 64
_ENTRY_MAX_BYTES = 1024  # of an entry in the directory, on average
_ENCRYPTED = 0x1
_HEADER_MAX_BYTES = 4096  # of an array
_SUFFIX = ".npy"
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


class BadArchive(ValueError):
    """The reason why an archive is refused; it follows the file name in a sentence."""


@dataclass(frozen=True)
class ArrayKind:
    """The type, number of dimensions and largest size of an array that an archive may hold."""

    dtype: str
    dimensions: int
    largest_bytes: int


def read_member(file: IO[bytes], name: str, largest_bytes: int) -> bytes:
    """One member of an archive. Raises `BadArchive`."""
    with _opened(file) as archive:
        found = [info for info in archive.infolist() if info.filename == name]
        if len(found) != 1:
            raise BadArchive(f"{len(found) or 'no'} members are called {name}")
        return _content(archive, found[0], largest_bytes)


def read_members(
    file: IO[bytes], wanted: Callable[[str], bool], *, largest_bytes: int, all_bytes: int, most: int
) -> dict[str, bytes]:
    """The wanted members, by name, of an archive that has at most `most` of any. Raises `BadArchive`."""
    with _opened(file, most) as archive:
        found = [info for info in archive.infolist() if wanted(info.filename)]
        if len({info.filename for info in found}) < len(found):
            raise BadArchive("two members have one name")
        if (total := sum(info.file_size for info in found)) > all_bytes:
            raise BadArchive(f"its members unpack to {in_mib(total)}; the limit is {in_mib(all_bytes)}")
        return {info.filename: _content(archive, info, largest_bytes) for info in found}


def member_names(file: IO[bytes]) -> list[str]:
    """The names of the members of an archive, in its order. Raises `BadArchive`."""
    with _opened(file) as archive:
        return archive.namelist()


def read_arrays(
    file: IO[bytes], known: Mapping[str, ArrayKind], *, wanted: Collection[str] = (), stored: bool = False
) -> dict[str, AnyArray]:
    """The `wanted` arrays (none: all) of a NumPy archive (.npz) that holds exactly those of `known`.

    `stored`: its writer packs nothing, so nothing packed is read. Raises `BadArchive`.
    """
    with _opened(file) as archive:
        infos = {info.filename: info for info in archive.infolist()}
        names = [info.filename for info in archive.infolist()]
        for name in names:
            if name.removesuffix(_SUFFIX) not in known or not name.endswith(_SUFFIX):
                raise BadArchive(f"the archive has an unknown member {name[:40]!r}")
            if names.count(name) > 1:
                raise BadArchive(f"the archive has {name[:40]!r} twice")
            if stored and infos[name].compress_type != zipfile.ZIP_STORED:
                raise BadArchive(f"array {name.removesuffix(_SUFFIX)} is packed")
        for name in known:
            if name + _SUFFIX not in infos:
                raise BadArchive(f"the archive has no array {name}")
        return {name: _array(archive, infos[name + _SUFFIX], name, known[name]) for name in wanted or known}


def _content(archive: zipfile.ZipFile, info: zipfile.ZipInfo, largest_bytes: int) -> bytes:
    _check(info, largest_bytes)
    try:
        with archive.open(info) as member:
            return member.read(info.file_size) + member.read(1)  # the second read compares the checksum
    except Exception as problem:  # zipfile, zlib and struct each raise errors of their own for a damaged member
        raise BadArchive(f"{info.filename} is damaged ({type(problem).__name__})") from problem


def _opened(file: IO[bytes], most: int = _ENTRIES_MAX) -> zipfile.ZipFile:
    """The archive, if its directory is small. Many entries alone would fill the memory."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(size - _END.size - _ZIP64_BYTES, 0))
    tail = file.read()
    if len(tail) < _END.size or tail[-_END.size :][: len(_END_MARK)] != _END_MARK:
        raise BadArchive("its content is no archive")
    _, _, _, _, entries, directory_bytes, _, _ = _END.unpack(tail[-_END.size :])
    if entries > most or directory_bytes > most * _ENTRY_MAX_BYTES or tail.startswith(_ZIP64_MARK):
        raise BadArchive(f"the archive announces {entries} members; the limit is {most}")
    try:
        return zipfile.ZipFile(file)
    except Exception as problem:  # a damaged directory fails in ways of its own
        raise BadArchive(f"its directory is damaged ({type(problem).__name__})") from problem


def _check(info: zipfile.ZipInfo, largest_bytes: int) -> None:
    if info.file_size > largest_bytes:
        raise BadArchive(f"{info.filename} unpacks to {in_mib(info.file_size)}; the limit is {in_mib(largest_bytes)}")
    if info.flag_bits & _ENCRYPTED or info.compress_type not in _METHODS:
        raise BadArchive(f"{info.filename} is encrypted, or packed by an unknown method")


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str, kind: ArrayKind) -> AnyArray:
    _check(info, kind.largest_bytes + _HEADER_MAX_BYTES)
    try:
        with archive.open(info) as member:
            version = npy.read_magic(member)
            shape, by_columns, dtype = _HEADERS[version](member, max_header_size=_HEADER_MAX_BYTES)
            held = info.file_size - member.tell()
            if dtype != np.dtype(kind.dtype) or len(shape) != kind.dimensions:
                wanted = f"{np.dtype(kind.dtype)} with {kind.dimensions} dimensions"
                raise BadArchive(f"array {name} is {dtype} with {len(shape)} dimensions, not {wanted}")
            size = math.prod(shape) * dtype.itemsize
            if min(shape, default=0) < 0 or size != held:
                raise BadArchive(f"array {name} of shape {shape} needs {in_mib(size)}, and {in_mib(held)} are there")
            if size > kind.largest_bytes:
                raise BadArchive(f"array {name} has {in_mib(size)}; the limit is {in_mib(kind.largest_bytes)}")
            values = np.empty(shape[::-1] if by_columns else shape, dtype)
            view = values.reshape(-1).view(np.uint8)
            for at in range(0, held, MIB):
                view[at : at + MIB] = np.frombuffer(member.read(min(MIB, held - at)), np.uint8)
            member.read(1)  # at the end the checksum is compared
    except BadArchive:
        raise
    except Exception as problem:  # NumPy, zipfile, zlib and Python's own parser each raise errors of their own
        raise BadArchive(f"array {name} is damaged ({type(problem).__name__})") from problem
    return values.T if by_columns else values
