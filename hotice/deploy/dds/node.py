"""One participant on one network interface of one domain, both named: nothing is ever sent where nobody said so."""

from __future__ import annotations

import socket
import weakref
from xml.sax.saxutils import quoteattr

from hotice.deploy.dds.cyclone import cyclone
from hotice.deploy.link.protocol import LinkError

LOOPBACK = "lo"
LARGEST_DOMAIN = 230


def configuration(interface: str) -> str:
    """Cyclone's configuration for one interface; what the environment says (CYCLONEDDS_URI) does not count.

    On loopback the robot's version has no multicast, so that both ends look for each other by address there.
    """
    local = (
        "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
        '<Peers><Peer address="localhost"/></Peers></Discovery>'
    )
    tail = local if interface == LOOPBACK else "</General>"
    return (
        f"<CycloneDDS><Domain><General><Interfaces><NetworkInterface name={quoteattr(interface)}/></Interfaces>"
        f"{tail}</Domain></CycloneDDS>"
    )


class DdsNode:
    """Carries the ends of links and services of one program; one per domain and process. Close it, or use `with`."""

    def __init__(self, *, domain: int, interface: str) -> None:
        """Joins the domain on the interface alone.

        Args:
            domain: 0 on the robot, another one for a simulated robot
            interface: name of the network interface, "lo" for this machine only

        Raises:
            LinkError: no such interface or domain, or the domain is open in this process already
            MissingExtra: without cyclonedds
        """
        names = [name for _, name in socket.if_nameindex()]
        if interface not in names:
            raise LinkError(f"no network interface {interface!r}: this machine has {', '.join(names)}")
        if isinstance(domain, bool) or not isinstance(domain, int) or not 0 <= domain <= LARGEST_DOMAIN:
            raise LinkError(f"domain {domain!r}: a whole number from 0 to {LARGEST_DOMAIN} is needed, the robot's is 0")
        dds = cyclone()
        try:
            self._domain = dds.domain.Domain(domain, configuration(interface))
            self.participant = dds.domain.DomainParticipant(domain)
        except dds.core.DDSException as error:
            raise LinkError(f"domain {domain} on {interface} cannot be opened: {error}") from None
        self._link: weakref.ref[object] | None = None

    def hold_link(self, link: object) -> None:
        """Makes it the one link of this node until `free_link`. Raises `LinkError` while there is another."""
        if self._link is not None and self._link() is not None:
            raise LinkError(
                "this node has a link already, and could not tell commands of two apart: close the first link, or "
                "open the second in another process"
            )
        self._link = weakref.ref(link)

    def free_link(self, link: object) -> None:
        """Undoes `hold_link`; does nothing for a link that is not held."""
        if self._link is not None and self._link() is link:
            self._link = None

    def close(self) -> None:
        """Leaves the domain; the ends that were made of it must be closed before."""
        self.participant = self._domain = None

    def __enter__(self) -> DdsNode:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
