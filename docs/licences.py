"""Page of the licences of all packages that drcmitsuba installs, by SPDX identifiers.

    python docs/licences.py

writes `docs/reference/licences.md` from the metadata of the packages of this environment, in which
`pip install '.[all]'` was run. A licence that the metadata do not tell by an identifier or a known
name is refused, so that the page has no gaps.
"""

from __future__ import annotations

import datetime
import platform
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PAGE = Path(__file__).resolve().parent / "reference" / "licences.md"
EXTRAS = ("llvm", "ifc", "cluster")
NAMES = {
    "MIT License": "MIT", "Apache Software License": "Apache-2.0", "Apache 2.0": "Apache-2.0",
    "ISC License (ISCL)": "ISC", "Python Software Foundation License": "PSF-2.0",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    **{name: name for name in ("MIT", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "MPL-2.0")},
}  # fmt: skip
"""Identifiers of SPDX by names that metadata have."""
CLAUSES = ("BSD License", "BSD")
"""Names of a family of licences: the text tells which it is."""
READ = {
    "openexr": "BSD-3-Clause", "karellen-llvm-core": "Apache-2.0 WITH LLVM-exception",
}  # fmt: skip
"""Identifiers that were read from the licences of packages whose metadata do not tell them."""


def installed() -> dict[str, metadata.Distribution]:
    """Packages that drcmitsuba needs in this environment, extras included, by name."""
    found: dict[str, metadata.Distribution] = {}
    waiting = [(Requirement("drcmitsuba"), EXTRAS)]
    seen = set()
    while waiting:
        requirement, extras = waiting.pop()
        name = canonicalize_name(requirement.name)
        if (name, extras) in seen:
            continue
        seen.add((name, extras))
        found[name] = metadata.distribution(name)
        for text in found[name].requires or ():
            inner = Requirement(text)
            asked = ({"extra": extra} for extra in (*extras, ""))
            if inner.marker is None or any(map(inner.marker.evaluate, asked)):
                waiting.append((inner, tuple(sorted(inner.extras))))
    return found


def licence(name: str, package: metadata.Distribution) -> str:
    """SPDX expression of a package's licence; KeyError where it is not known."""
    about = package.metadata
    if name in READ:
        return READ[name]
    if expression := about.get("License-Expression"):
        return expression
    told = [(about.get("License") or "").strip()]
    told += [text.rpartition(" :: ")[2] for text in about.get_all("Classifier") or ()
             if text.startswith("License :: ")]  # fmt: skip
    known = next((NAMES[text] for text in told if text in NAMES), "")
    if not known and any(text in CLAUSES for text in told):
        files = [f for f in package.files or () if f.name.upper().startswith("LICEN")]
        text = " ".join(Path(str(files[0].locate())).read_text("utf-8").split()).lower()
        known = "BSD-3-Clause" if "neither the name" in text else "BSD-2-Clause"
    if not known:
        raise KeyError(f"{name}: what is {told} by SPDX? Add it to NAMES or READ")
    return known


def page() -> str:
    """Text of the page."""
    packages = installed()
    del packages["drcmitsuba"]
    rows = [f"| {n} | {p.version} | {licence(n, p)} |" for n, p in sorted(packages.items())]
    where = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
    return "\n".join([
        "# Licences", "",
        "drcmitsuba is under BSD-3-Clause. It installs these packages, with the extras `llvm`,",
        "`ifc` and `cluster`; each keeps its own licence, by the names of",
        "[SPDX](https://spdx.org/licenses/).",
        f"Made on {datetime.date.today()} by `python docs/licences.py` ({where}).", "",
        "| package | version | licence |", "|---|---|---|", *rows, "",
    ])  # fmt: skip


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
