"""Signing keys: read from files and the environment, shown nowhere."""

from __future__ import annotations

import hashlib
import os
import threading
from pathlib import Path

import pytest

from gcs.cli.shared.shared_options import connection
from gcs.errors import UsageError
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from gcs.link.wire.signing import KEY_BYTES
from gcs.link.wire.signing_keys import load_key, signing_with

HEX = "0123456789abcdef" * 4
PHRASE = "correct horse battery staple"


@pytest.fixture
def key_file(tmp_path):
    def write(data, mode=0o600):
        path = tmp_path / "key"
        path.write_bytes(data)
        path.chmod(mode)
        return path

    return write


@pytest.mark.parametrize(
    ("data", "key"),
    [
        (HEX.encode(), bytes.fromhex(HEX)),
        (HEX.upper().encode() + b"\n", bytes.fromhex(HEX)),
        (PHRASE.encode() + b"\n", hashlib.sha256(PHRASE.encode()).digest()),
        (bytes(range(200, 232)), bytes(range(200, 232))),
    ],
    ids=["hexadecimal", "capitals and a line's end", "passphrase", "bytes"],
)
def test_forms_of_a_key(key_file, data, key):
    assert load_key(key_file(data), {}) == key


def test_the_environment_is_asked_where_there_is_no_file(key_file):
    assert load_key(None, {"SKEIN_SIGNING_KEY": HEX}) == bytes.fromhex(HEX)
    assert load_key(None, {}) is None
    assert load_key(key_file(PHRASE.encode()), {"SKEIN_SIGNING_KEY": HEX}) != bytes.fromhex(HEX)


@pytest.mark.parametrize("data", [b"", b"short", b"\xff" * 31, b"0" * 64, b"x" * 5000])
def test_what_is_no_key_is_refused_and_not_shown(key_file, data):
    with pytest.raises(UsageError) as caught:
        load_key(key_file(data), {})
    if data:
        assert data.decode("latin-1") not in caught.value.message + caught.value.hint


def test_a_key_that_others_can_read_is_refused(key_file):
    with pytest.raises(UsageError, match="can be read by other users"):
        load_key(key_file(HEX.encode(), 0o644), {})
    with pytest.raises(UsageError, match="No such file"):
        load_key(key_file(HEX.encode()).with_name("nothing"), {})


def test_a_program_may_print_the_key_into_a_pipe() -> None:
    """As `--signing-key-file <(command)` of a shell does; it may print it in pieces, and late."""
    reading, writing = os.pipe()
    program = threading.Thread(target=lambda: [os.write(writing, part) for part in (b"", HEX[:20].encode())])
    rest = threading.Timer(0.1, lambda: (os.write(writing, HEX[20:].encode()), os.close(writing)))
    program.start()
    rest.start()
    assert load_key(Path(f"/dev/fd/{reading}"), {}) == bytes.fromhex(HEX)
    rest.join()
    os.close(reading)


def test_no_representation_shows_the_key(key_file, monkeypatch):
    monkeypatch.delenv("SKEIN_SIGNING_KEY", raising=False)
    known = connection(["tcp:127.0.0.1:5760"], "1=7", key_file(HEX.encode()))
    assert known.key == bytes.fromhex(HEX)
    signing = signing_with(known.key, 0.0, 1.8e9)
    shown = f"{known!r} {known} {signing!r} {signing.signature(0.0)!r}"
    assert HEX not in shown
    assert repr(known.key) not in shown


def test_time_in_signatures_is_counted_from_2015():
    signature = signing_with(bytes(range(32)), 5.0, 1_420_070_400 + 10.0).signature(7.0)
    assert signature.ticks == 12 * 100_000 + 1
    assert signing_with(None, 0.0) is None


@pytest.mark.parametrize("text", ["1", "1=", "=7", "a=7", "1=255", "0=1", "1=7,1=8", "1=7;2=8", "1=7,,2=8"])
def test_bad_maps_are_quoted(text):
    with pytest.raises(UsageError) as caught:
        connection(None, text)
    assert repr(text) in caught.value.message


def test_maps_and_links():
    assert connection(None, "1=7, 2=8").systems == {1: 7, 2: 8}
    with pytest.raises(UsageError, match="twice"):
        connection(["udpin:127.0.0.1:1", "udpin:127.0.0.1:1"])
    with pytest.raises(UsageError, match="does not name a link"):
        connection(["nonsense"])


def test_a_station_whose_clock_was_never_set_signs_until_a_vehicle_tells_the_time() -> None:
    key = bytes([7]) * KEY_BYTES
    station, vehicle = signing_with(key, 5.0, 1000.0), signing_with(key, 5.0, 1_795_331_000.0)
    assert station is not None and vehicle is not None
    beat = Message("MISSION_CURRENT", {"seq": 0})
    first = Codec(255, 190).encode(beat, station.signature(5.0))
    assert station.accepts(Codec(1, 1).encode(beat, vehicle.signature(6.0)), 6.0)
    assert vehicle.accepts(Codec(255, 190).encode(beat, station.signature(6.0)), 6.0)
    assert not vehicle.accepts(first, 6.0)
