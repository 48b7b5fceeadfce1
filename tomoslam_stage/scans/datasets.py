"""A dataset from the outside: shape and type, the filters it needs, the files it draws on."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy as np
    from h5py import File

FILTERS = {
    307: "bzip2",
    32001: "Blosc",
    32004: "LZ4",
    32008: "Bitshuffle",
    32013: "ZFP",
    32015: "Zstandard",
    32017: "SZ",
    32018: "FCIDECOMP",
    32024: "SZ3",
    32026: "Blosc2",
    32028: "SPERR",
}
"""Those that hdf5plugin brings, by the number The HDF Group registered them under."""


NO_END = 2**62
"""A selection without an end, which grows with its source, ends beyond this."""


@dataclass(frozen=True)
class DatasetFacts:
    """A dataset from the outside."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    chunks: tuple[int, ...] | None
    unreadable: tuple[str, str] | None = None
    """What its values cannot be read without, and what to do; None where they can be read."""


def look(file: File, key: str) -> DatasetFacts | str:
    """Return the facts of a dataset, or say why it cannot be used."""
    import h5py

    broken = _broken_link(file, key)
    if broken is not None:
        return broken
    found = file[key]
    if not isinstance(found, h5py.Dataset):
        kind = "group" if isinstance(found, h5py.Group) else "stored type"
        return f"is a {kind}; a dataset is needed"
    if found.shape is None:
        return "is empty: a dataset without any space"
    return DatasetFacts(found.shape, found.dtype, found.chunks, _why_unreadable(found))


def _broken_link(file: File, key: str) -> str | None:
    """Say where the way to `key` ends before it gets there; None where it does not."""
    import h5py

    parts = key.strip("/").split("/")
    for place in ("/" + "/".join(parts[: i + 1]) for i in range(len(parts))):
        link = file.get(place, getlink=True)
        if link is None:
            return "is missing"
        if isinstance(link, h5py.HardLink):
            continue
        try:
            file[place]
        except (KeyError, OSError, RuntimeError):
            leads = f"is a link to {link.path}{_where_it_ends(file, link)}"
            return leads if place == key else f"is missing: {place} {leads}"
    return None


def _where_it_ends(file: File, link: Any) -> str:
    import h5py

    if not isinstance(link, h5py.ExternalLink):
        return ", which is missing"
    target = Path(file.filename).parent / link.filename
    if not target.exists():
        return f" in {link.filename}, which is missing"
    holds = "has no such dataset" if h5py.is_hdf5(target) else "is not an HDF5 file"
    return f" in {link.filename}, which {holds}"


def _why_unreadable(dataset: Any) -> tuple[str, str] | None:
    filters = list(_missing_filters(dataset))
    if filters:
        names = ", ".join(_named(code, label) for code, label in filters)
        known = all(code in FILTERS for code, _ in filters)
        remedy = "the package hdf5plugin" if known else "that filter's HDF5 plugin"
        return f"is compressed with {names}, which is not installed.", f"Install {remedy}."
    raw = sorted(set(_missing_raw_files(dataset)))
    if raw:
        found = f"draws on {', '.join(raw)}, which is missing or too short."
        return found, "HDF5 looks for it where the program was started: start beside it."
    gaps = sorted(set(_missing_sources(dataset, frozenset())))
    if gaps:
        return f"draws on {', '.join(gaps)}.", "Put it back beside the scan."
    return None


def _named(code: int, label: str) -> str:
    return f"{FILTERS.get(code) or label or 'an unknown filter'} (filter {code})"


def _missing_filters(dataset: Any) -> Iterator[tuple[int, str]]:
    """Yield number and label of the filters that are not installed."""
    from h5py import h5z

    plist = dataset.id.get_create_plist()
    for i in range(plist.get_nfilters()):
        code, _, _, label = plist.get_filter(i)
        if not h5z.filter_avail(code) and not _plugins_bring(code):
            yield code, label.decode("utf-8", "replace")


def _plugins_bring(code: int) -> bool:
    """Load the optional collection of filters, for the files that need one."""
    from h5py import h5z

    try:
        import_module("hdf5plugin")
    except ImportError:
        return False
    return bool(h5z.filter_avail(code))


def _missing_raw_files(dataset: Any) -> Iterator[str]:
    """Name the raw files behind a dataset that lack bytes, in whose place HDF5 gives zeros."""
    from h5py import h5f

    for name, offset, size in dataset.external or ():
        place = Path(name)  # relative to the working directory, as for HDF5
        needed = offset if size == h5f.UNLIMITED else offset + size
        if not place.is_file() or place.stat().st_size < needed:
            yield name


def _missing_sources(dataset: Any, seen: frozenset[tuple[str, str]]) -> Iterator[str]:
    """Name the sources of a virtual dataset that are gone; HDF5 gives fill values for them."""
    if not dataset.is_virtual:
        return
    taken: dict[tuple[str, str], list[Any]] = {}
    for source in dataset.virtual_sources():
        taken.setdefault((source.file_name, source.dset_name), []).append(source)
    this = Path(dataset.file.filename)
    for (name, inner), sources in taken.items():
        place = this if name == "." else this.parent / name
        if "%" in name or (str(place), inner) in seen:  # "%": a pattern that HDF5 resolves
            continue
        if not place.exists():
            yield f"{name}, which is missing"
        else:
            yield from _missing_inside(place, sources, seen | {(str(place), inner)})


def _missing_inside(
    place: Path, sources: Sequence[Any], seen: frozenset[tuple[str, str]]
) -> Iterator[str]:
    """Name what `sources`, all of one dataset in the file `place`, cannot give."""
    import h5py

    name, inner = sources[0].file_name, sources[0].dset_name
    try:
        with h5py.File(place, "r") as file:
            found = file.get(inner)
            if not isinstance(found, h5py.Dataset):
                yield f"{inner} in {name}, which is missing"
            elif not all(_reaches(found, source) for source in sources):
                yield f"{inner} in {name}, which is shorter than it was"
            else:
                yield from _missing_sources(found, seen)
    except OSError:
        yield f"{name}, which cannot be opened"


def _reaches(dataset: Any, source: Any) -> bool:
    """Whether a dataset holds all that a virtual dataset takes from it."""
    from h5py import h5s

    chosen = source.src_space
    if chosen.get_select_type() == h5s.SEL_ALL:
        return bool(dataset.size >= source.vspace.get_select_npoints())
    if not chosen.is_regular_hyperslab():  # HDF5 itself says when it reads what is not there
        return True
    parts = zip(*chosen.get_regular_hyperslab(), strict=True)
    ends = [start + (count - 1) * stride + block for start, stride, count, block in parts]
    pairs = zip(ends, dataset.shape, strict=False)
    return len(ends) == dataset.ndim and all(end <= size or end >= NO_END for end, size in pairs)
