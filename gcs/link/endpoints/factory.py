"""The endpoint class of each kind of link."""

from __future__ import annotations

from gcs.link.endpoints.base import Endpoint, LinkMode, LinkSpec, parse_link_spec
from gcs.link.endpoints.serial import SerialEndpoint
from gcs.link.endpoints.tcp import TcpEndpoint
from gcs.link.endpoints.udp import UdpEndpoint


def make_endpoint(spec: LinkSpec | str) -> Endpoint:
    """Return the endpoint of a spec, not open yet. Raises `UsageError` for text that names no link."""
    spec = parse_link_spec(spec) if isinstance(spec, str) else spec
    if spec.mode is LinkMode.TCP:
        return TcpEndpoint(spec)
    if spec.mode is LinkMode.SERIAL:
        return SerialEndpoint(spec)
    return UdpEndpoint(spec)
