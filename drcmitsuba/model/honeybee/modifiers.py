"""Which Radiance modifier an object of an HBJSON file has; Honeybee's default modifier set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from drcmitsuba.model import radiance_materials
from drcmitsuba.model.honeybee.bsdf_files import BsdfFiles
from drcmitsuba.model.honeybee.entries import JsonEntry, by_identifier
from drcmitsuba.model.honeybee.modifier_materials import material_of
from drcmitsuba.model.materials import GlazingMaterial, Lambertian, SurfaceMaterial
from drcmitsuba.model.notes import Notes

GLASS = {"generic_exterior_window_vis_0.64": 0.64, "generic_interior_window_vis_0.88": 0.88}
"""Transmittance of the panes of Honeybee's default set at normal incidence [–]."""
PLASTIC = {
    "generic_wall_0.50": 0.5,
    "generic_ceiling_0.80": 0.8,
    "generic_floor_0.20": 0.2,
    "generic_opaque_door_0.50": 0.5,
    "generic_interior_shade_0.50": 0.5,
    "generic_exterior_shade_0.35": 0.35,
    "generic_context_0.20": 0.2,
}
"""Reflectance of the surfaces of Honeybee's default set [–]."""
DEFAULT_SET: Mapping[str, object] = {
    "wall_set": dict.fromkeys(("interior_modifier", "exterior_modifier"), "generic_wall_0.50"),
    "floor_set": dict.fromkeys(("interior_modifier", "exterior_modifier"), "generic_floor_0.20"),
    "roof_ceiling_set": dict.fromkeys(
        ("interior_modifier", "exterior_modifier"), "generic_ceiling_0.80"
    ),
    "aperture_set": {
        "interior_modifier": "generic_interior_window_vis_0.88",
        "window_modifier": "generic_exterior_window_vis_0.64",
        "skylight_modifier": "generic_exterior_window_vis_0.64",
        "operable_modifier": "generic_exterior_window_vis_0.64",
    },
    "door_set": {
        "interior_modifier": "generic_opaque_door_0.50",
        "exterior_modifier": "generic_opaque_door_0.50",
        "overhead_modifier": "generic_opaque_door_0.50",
        "interior_glass_modifier": "generic_interior_window_vis_0.88",
        "exterior_glass_modifier": "generic_exterior_window_vis_0.64",
    },
    "shade_set": {
        "interior_modifier": "generic_interior_shade_0.50",
        "exterior_modifier": "generic_exterior_shade_0.35",
    },
    "context_modifier": "generic_context_0.20",
}
"""Names of the modifiers that objects take which have none: Honeybee's
Generic_Interior_Visible_Modifier_Set, as its files state it under `global_modifier_set`."""


@dataclass
class Modifiers:
    """Modifiers and modifier sets of a model; materials are made when surfaces ask for them."""

    known: dict[str, JsonEntry]
    """Modifiers of the file by their identifiers."""
    sets: Mapping[str, JsonEntry]
    """Modifier sets of the rooms."""
    defaults: tuple[JsonEntry, ...]
    """Modifier sets of the model, the one that counts first; the last is Honeybee's default."""
    bsdf: BsdfFiles
    """Files of BSDF modifiers."""
    notes: Notes = field(default_factory=Notes)
    materials: dict[str, SurfaceMaterial | None] = field(default_factory=dict)

    def name(self, own: JsonEntry, room_set: JsonEntry | None, family: str, kind: str) -> str:
        """Name of an object's modifier: its own, or the one of its room's or the model's set.

        Parameters
        ----------
        own : Entry
            Radiance properties of the object.
        room_set : Entry | None
            Modifier set of its room.
        family, kind : str
            Keys in a modifier set, such as "wall_set" and "exterior_modifier"; "" for a modifier
            that the set holds itself.
        """
        named = self.named(own, "modifier")
        for each in () if named else (room_set, *self.defaults):
            if named is None and each is not None:
                named = self.named(each.inner(family) if family else each, kind)
        if named is None:
            raise own.refuse(kind, "no modifier in any set", "give the object a modifier")
        return named

    def named(self, holder: JsonEntry, key: str) -> str | None:
        """Name of the modifier in a field, which holds a name or a whole modifier."""
        if isinstance(holder.fields.get(key), dict):
            modifier = holder.inner(key)
            name = modifier.text("identifier") or modifier.text("type") or ""
            self.known.setdefault(name, modifier)
            return name
        return holder.text(key)

    def set_of(self, room: JsonEntry) -> JsonEntry | None:
        """Modifier set of a room; None where it has none of its own."""
        name = self.named(room.inner("properties", "radiance"), "modifier_set")
        if name is not None and name not in self.sets:
            got = f"{name}, which the file lacks"
            raise room.refuse("modifier_set", got, "add it to modifier_sets")
        return None if name is None else self.sets[name]

    def material(self, name: str, user: JsonEntry) -> SurfaceMaterial | None:
        """Material of a modifier that an object uses; None for void, which is an opening."""
        if name not in self.materials:
            if name in self.known:
                self.materials[name] = material_of(self.known[name], self.bsdf, self.notes)
            elif name in GLASS:
                self.materials[name] = GlazingMaterial(
                    type="glazing", transmittance=GLASS[name], ior=radiance_materials.INDEX
                )
            elif name in PLASTIC:
                self.materials[name] = Lambertian(PLASTIC[name])
            elif name.lower() == "void":
                self.materials[name] = None
            else:
                remedy = "add it to properties.radiance.modifiers, or choose another"
                raise user.refuse("modifier", f"{name}, which the file lacks", remedy)
            if name not in self.known and name in (*GLASS, *PLASTIC):
                self.notes.add("Honeybee's default set gives", name)
        return self.materials[name]


def modifiers_of(model: JsonEntry, bsdf: Mapping[str, Path]) -> Modifiers:
    """Modifiers and modifier sets of a model; `bsdf` has the files of BSDF modifiers."""
    radiance = model.inner("properties", "radiance")
    sets = by_identifier(radiance.entries("modifier_sets"), alike=True)
    built_in = JsonEntry(model.file, "Honeybee's default set", DEFAULT_SET)
    known = by_identifier(radiance.entries("modifiers"), alike=True)
    chosen = radiance.fields.get("global_modifier_set")
    if isinstance(chosen, str):
        if chosen not in sets:
            got = f"{chosen}, which the file lacks"
            raise radiance.refuse("global_modifier_set", got, "add it to modifier_sets")
        return Modifiers(known, sets, (sets[chosen], built_in), BsdfFiles(bsdf))
    whole = radiance.inner("global_modifier_set")
    for name, modifier in by_identifier(whole.entries("modifiers"), alike=True).items():
        known.setdefault(name, modifier)
    return Modifiers(known, sets, (whole, built_in), BsdfFiles(bsdf))
