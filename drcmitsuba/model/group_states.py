"""States of a model's groups: what stands in the first one, and groups put in one for good."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from drcmitsuba.model.model import Layer, Model


def in_first_state(model: Model) -> Model:
    """Add the surfaces that stand in the first state of every group."""
    layers: list[Layer] = []
    for layer in model.layers:
        layers.append(layer)
        if layer.states:
            layers += [replace(s, stands_in=layer.group) for s in layer.states[0].shades]
    return replace(model, layers=tuple(layers))


def in_states(model: Model, taken: Mapping[str, int]) -> Model:
    """Put some groups in one of their states, by its number: they have no other then.

    The model is one of `in_first_state`. Layers have the names of the materials that they take;
    what a state leaves open has no surface, and is no window either.
    """
    layers = tuple(own for layer in model.layers for own in _taken(layer, taken))
    return replace(model, layers=layers)


def _taken(layer: Layer, taken: Mapping[str, int]) -> Iterator[Layer]:
    """Surfaces of a layer whose group has taken a state; the layer itself where none has."""
    if layer.stands_in in taken:
        if taken[layer.stands_in] == 0:
            yield replace(layer, stands_in="")
    elif layer.group in taken and layer.states:
        number = min(taken[layer.group], len(layer.states) - 1)
        state, own = layer.states[number], replace(layer, group="", states=())
        if number == 0:
            yield own
        else:
            if state.material is not None:
                yield replace(own, name=state.name, material=state.material)
            yield from state.shades
    else:
        yield layer
