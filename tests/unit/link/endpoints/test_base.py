import pytest

from gcs.errors import UsageError
from gcs.link.endpoints.base import LinkMode, LinkSpec, parse_link_spec


@pytest.mark.parametrize(
    ("text", "spec"),
    [
        ("udpin:0.0.0.0:14550", LinkSpec(LinkMode.LISTEN, "0.0.0.0", 14550)),
        ("udpout:sim.local:14540", LinkSpec(LinkMode.CALL, "sim.local", 14540)),
        ("127.0.0.1:14550", LinkSpec(LinkMode.LISTEN, "127.0.0.1", 14550)),
        ("tcp:127.0.0.1:5760", LinkSpec(LinkMode.TCP, "127.0.0.1", 5760)),
        ("udpin:[::1]:14550", LinkSpec(LinkMode.LISTEN, "::1", 14550)),
        ("[::]:14550", LinkSpec(LinkMode.LISTEN, "::", 14550)),
        ("udpout:[fe80::2%eth0]:14540", LinkSpec(LinkMode.CALL, "fe80::2%eth0", 14540)),
        ("tcp:[2001:db8::7]:5760", LinkSpec(LinkMode.TCP, "2001:db8::7", 5760)),
        ("serial:/dev/ttyUSB0:921600", LinkSpec(LinkMode.SERIAL, "/dev/ttyUSB0", 921600)),
        ("/dev/ttyACM0", LinkSpec(LinkMode.SERIAL, "/dev/ttyACM0", 57600)),
        ("/dev/by-path/pci-0:1:1.0-port0", LinkSpec(LinkMode.SERIAL, "/dev/by-path/pci-0:1:1.0-port0", 57600)),
    ],
)
def test_links_by_name(text, spec):
    assert parse_link_spec(text) == spec
    assert parse_link_spec(str(spec)) == spec


@pytest.mark.parametrize("text", ["fe80::1:5760", "udpin:::1:14550", "udpout:2001:db8::7:14550", "tcp:fe80::1:5760"])
def test_an_ipv6_host_without_brackets_is_told_how_to_be_written(text):
    with pytest.raises(UsageError) as caught:
        parse_link_spec(text)
    assert "in brackets" in caught.value.hint


def test_a_kind_of_link_that_is_not_here_is_no_ipv6_host():
    with pytest.raises(UsageError, match="KIND udpin, udpout or tcp") as caught:
        parse_link_spec("tcpin:0.0.0.0:5760")
    assert "bracket" not in caught.value.hint


@pytest.mark.parametrize(
    "text",
    [
        *(
            "",
            "14550",
            "udpin:",
            "udpin:host",
            "udpout:h:0",
            "udpin:h:99999",
            "tcp:h:1:2",
            "udpin::5",
            "h:²",
            "udpin:[::1]",
            "[127.0.0.1]:5",
        ),
        *("tcp:h:0", "serial:", "/dev/x:0"),
    ],
)
def test_bad_names_are_quoted_with_an_example(text):
    with pytest.raises(UsageError) as caught:
        parse_link_spec(text)
    assert repr(text) in caught.value.message
    assert "udpin:127.0.0.1:14550" in caught.value.hint


@pytest.mark.parametrize(
    ("text", "here"),
    [
        ("udp:127.0.0.1:14550", "udpin:127.0.0.1:14550"),
        ("udp:14550", "udpin:0.0.0.0:14550"),
        ("udp://:14540", "udpin:0.0.0.0:14540"),
        ("udpin://0.0.0.0:14540", "udpin:0.0.0.0:14540"),
        ("tcp://127.0.0.1:5760", "tcp:127.0.0.1:5760"),
        ("tcpout:127.0.0.1:5760", "tcp:127.0.0.1:5760"),
        ("udpcl:10.0.0.5:14550", "udpout:10.0.0.5:14550"),
        ("/dev/ttyACM0,115200", "serial:/dev/ttyACM0:115200"),
        ("serial:///dev/ttyACM0:57600", "serial:/dev/ttyACM0:57600"),
        ("udp:[::1]:14550", "udpin:[::1]:14550"),
    ],
)
def test_a_link_as_other_programs_write_it_is_told_in_our_form(text, here):
    with pytest.raises(UsageError, match="does not name a link") as caught:
        parse_link_spec(text)
    assert caught.value.hint == f"write {here}"
    parse_link_spec(here)
