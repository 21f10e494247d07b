"""Decision on one effect of light, or on one piece of work: simulated or not, and why."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any


@dataclass(frozen=True)
class Effect:
    """Decision on one effect.

    Parameters
    ----------
    on : bool
        The effect is simulated.
    reason : str
        Reason of the decision, with the quantity that decides.
    quantities : dict
        Quantities that decide, by name.
    missing : bool
        The scene calls for the effect, but the program cannot simulate it here.
    overruled : bool
        A choice of the case decided, not the scene.
    """

    on: bool
    reason: str
    quantities: dict[str, Any] = field(default_factory=dict)
    missing: bool = False
    overruled: bool = False

    def decided(self, name: str, choice: str) -> Effect:
        """Apply the case's own choice: "auto", "all" or "off"."""
        on = {"auto": self.on, "all": True, "off": False}[choice]
        if choice == "auto" or (on == self.on and choice == "off"):
            return self
        reason = f'{self.reason}; overruled by [effects] {name} = "{choice}"'
        return replace(self, on=on, reason=reason, overruled=True, missing=False)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for plan.json."""
        out: dict[str, Any] = {"on": self.on, "reason": self.reason}
        if self.missing:
            out["missing"] = True
        if self.overruled:
            out["overruled"] = True
        return out | self.quantities
