"""Paths that the states of a façade share."""

from __future__ import annotations

from dataclasses import dataclass, field

from drcmitsuba.transport.interior import SharedInterior
from drcmitsuba.transport.shared_photons import SharedPhotons


@dataclass(frozen=True)
class SharedPaths:
    """Paths among the surfaces of a room, and photons: the latest that were all traced."""

    interior: SharedInterior = field(default_factory=SharedInterior)
    photons: SharedPhotons = field(default_factory=SharedPhotons)

    def forget(self) -> None:
        """Give back the memory."""
        self.interior.forget()
        self.photons.forget()
