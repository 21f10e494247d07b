"""Arrays of a dataset that are made when their values are first asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core.indexing import IndexingSupport, LazilyIndexedArray, explicit_indexing_adapter


class LaterArrays:
    """Arrays that are made together.

    Parameters
    ----------
    make : callable
        Function that makes a dataset with all of them.
    """

    def __init__(self, make: Callable[[], xr.Dataset]) -> None:
        self._make = make

    @cached_property
    def made(self) -> xr.Dataset:
        """Dataset, once it was asked for."""
        return self._make()

    def variables(self, names: Sequence[str], like: xr.Variable) -> dict[str, xr.Variable]:
        """Variables with the dims and the type of another one."""
        return {
            name: xr.Variable(like.dims, LazilyIndexedArray(_LaterArray(self, name, like)))
            for name in names
        }


class _LaterArray(BackendArray):
    """One of the arrays, as xarray reads arrays from files."""

    def __init__(self, source: LaterArrays, name: str, like: xr.Variable) -> None:
        self.shape, self.dtype, self.dims = like.shape, like.dtype, like.dims
        self._source, self._name = source, name

    def __getitem__(self, key: Any) -> Any:
        return explicit_indexing_adapter(key, self.shape, IndexingSupport.BASIC, self._at)

    def _at(self, key: tuple[Any, ...]) -> np.ndarray:
        return np.asarray(self._source.made[self._name].transpose(*self.dims).values[key])
