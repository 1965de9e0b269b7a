"""What a search saw: the landscape of the goal over what was varied, and what it costs in frequency and mass."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import frequency, level_figure
from pipeline.search.fidelity import COLUMN, PLATE, STRIP
from pipeline.units import GRAM, KHZ

GOALS = {
    "confinement": ("confinement_db", "confinement (dB)"),
    "extension": ("extension_db", "zone to extension (dB)"),
    "worst": ("worst_db", "least confinement, heights off (dB)"),
    "widest": ("band_khz", "band in which rows take 10 dB (kHz)"),
    "isolation": ("isolation_db", "driven zone over the others (dB)"),
    "closest": ("gap_mm", "gap between zones (mm)"),
}


def landscape(document: dict[str, Any]) -> ReportFigure:
    """Draw the goal over one or two keys, and the goal against frequency and mass, from a search's document."""
    document = _numbered(document)
    figure, (left, right) = style.panels(3.9, 1, 2, width_ratios=[1.15, 1.0])
    key, label = GOALS[document["goal"]]
    over_keys(left, document)
    _tradeoff(right, document, key, label)
    return ReportFigure(
        "search", "Where the wanted mode is confined best", _alt(document, key, label), figure, vector=True
    )


def _numbered(document: dict[str, Any]) -> dict[str, Any]:
    """The document with words of keys that have two as 0 and 1."""
    words = {each["key"]: each["words"] for each in document["vary"] if "words" in each}

    def numbered(design: dict[str, Any]) -> dict[str, Any]:
        return design | {"set": {k: words[k].index(v) if isinstance(v, str) else v for k, v in design["set"].items()}}

    lists = {name: [numbered(each) for each in document[name]] for name in ("evaluations", "tradeoff")}
    return document | lists | {name: numbered(document[name]) for name in ("base", "best")} if words else document


def over_keys(axes: Any, document: dict[str, Any]) -> None:
    """Draw the goal over one or two keys into axes."""
    document = _numbered(document)
    key, label = GOALS[document["goal"]]
    keys = shown_keys(document)
    if len(keys) == 1:
        _line(axes, document, keys[0], key, label)
    else:
        _map(axes, document, keys, key, label)


def shown_keys(document: dict[str, Any]) -> list[str]:
    """The one or two keys of the landscape: of several, those that the cheapest fidelity's goal follows most (rank
    correlation).
    """
    keys = [each["key"] for each in document["vary"]]
    if len(keys) <= 2:
        return keys
    from scipy.stats import spearmanr

    key = GOALS[document["goal"]][0]
    known = ([e for e in _of(document, name) if e[key] is not None] for name in (STRIP, COLUMN, PLATE))
    screened = next((listed for listed in known if listed), [])
    goal = [each[key] for each in screened]
    strength = {k: abs(spearmanr([e["set"][k] for e in screened], goal).statistic) for k in keys}
    return sorted(keys, key=lambda k: -np.nan_to_num(strength[k]))[:2]


def _of(document: dict[str, Any], fidelity: str) -> list[dict[str, Any]]:
    return [each for each in document["evaluations"] if each["fidelity"] == fidelity]


def _points(listed: list[dict[str, Any]], keys: list[str], value: str) -> Any:
    """Columns of the keys' values and the goal's, of the evaluated designs."""
    return np.array([[*(e["set"][k] for k in keys), e[value]] for e in listed if e[value] is not None]).T


def _line(axes: Any, document: dict[str, Any], key: str, value: str, label: str) -> None:
    """Draw the goal over one key, by every fidelity."""
    looks = {STRIP: (style.GREY, "", "-"), COLUMN: (style.SKY, "s", ""), PLATE: (style.BLUE, "o", "")}
    for fidelity, (colour, marker, line) in looks.items():
        points = _points(_of(document, fidelity), [key], value)
        if points.size:
            x, y = points[:, np.argsort(points[0])]
            axes.plot(x, y, color=colour, marker=marker or None, ls=line or "none", ms=4, label=fidelity)
    best = document["best"]
    axes.plot(best["set"][key], best[value], "*", color=style.VERMILION, ms=13, label="best")
    axes.set(xlabel=axis_words(key), ylabel=label, title="Landscape")
    axes.grid(True)
    axes.legend(fontsize=7)


def _map(axes: Any, document: dict[str, Any], keys: list[str], value: str, label: str) -> None:
    """The goal over two keys: the strips as a ground, the computed designs as points of the same colours."""
    strips, plates = _points(_of(document, STRIP), keys, value), _points(_of(document, PLATE), keys, value)
    low = min(0.0, float(np.percentile(strips[2], 5))) if strips.size else 0.0
    high = max(float(np.percentile(strips[2], 99)) if strips.size else 1.0, *plates[2], low + 1.0)
    look = {"cmap": style.QUALITY, "vmin": low, "vmax": high}
    if strips.size and len(document["vary"]) == 2:
        axes.tripcolor(*strips[:2], strips[2], shading="gouraud", rasterized=True, **look)
    columns = _points(_of(document, COLUMN), keys, value)
    if columns.size:
        own = {"marker": "s", "s": 14, "edgecolors": "white", "linewidths": 0.5, "label": "column"}
        axes.scatter(*columns[:2], c=columns[2], **own, **look)
    own = {"marker": "o", "s": 42, "edgecolors": "black", "linewidths": 0.8, "label": "assembled plate"}
    image = axes.scatter(*plates[:2], c=plates[2], **own, **look)
    best = document["best"]["set"]
    axes.plot(best[keys[0]], best[keys[1]], "*", color=style.VERMILION, mec="white", ms=15, ls="none", label="best")
    axes.set(xlabel=axis_words(keys[0]), ylabel=axis_words(keys[1]), title="Landscape (ground: strips)")
    axes.legend(fontsize=7, loc="upper right", framealpha=0.8, frameon=True)
    axes.figure.colorbar(image, ax=axes, label=label)


def _tradeoff(axes: Any, document: dict[str, Any], value: str, label: str) -> None:
    """The goal against frequency, coloured by mass; designs that no other beats are connected."""
    for fidelity, look in ((COLUMN, {"marker": "s", "s": 12, "alpha": 0.6}), (PLATE, {"marker": "o", "s": 36})):
        listed = [e for e in _of(document, fidelity) if e[value] is not None and not e["violations"]]
        if not listed:
            continue
        mass = [e["mass_kg"] / GRAM if e["mass_kg"] is not None else np.nan for e in listed]
        x, y = [e["frequency_hz"] / KHZ for e in listed], [e[value] for e in listed]
        own = {"cmap": "viridis_r", "plotnonfinite": True, "edgecolors": "black", "linewidths": 0.4}
        image = axes.scatter(x, y, c=mass, **own, **look)
    axes.figure.colorbar(image, ax=axes, label="mass (g)")
    front = sorted((e["frequency_hz"] / KHZ, e[value]) for e in document["tradeoff"])
    axes.plot(*zip(*front, strict=True), color=style.GREY, lw=0.8, ls="--", label="no other design beats these")
    for name, marker, colour in (("base", "D", style.ORANGE), ("best", "*", style.VERMILION)):
        each = document[name]
        if each[value] is not None:
            label_ = "as given" if name == "base" else "best"
            axes.plot(each["frequency_hz"] / KHZ, each[value], marker, color=colour, mec="white", ms=11, label=label_)
    axes.axvline(document["limits"]["lowest_hz"] / KHZ, color=style.GREY, lw=0.8, ls=":")
    axes.set(xlabel="frequency of the wanted mode (kHz)", ylabel=label, title="Trade-off")
    axes.grid(True)
    axes.legend(fontsize=7)


def axis_words(key: str) -> str:
    """A key of the case file as an axis title."""
    name, _, unit = key.partition(".")[2].rpartition("_")
    return f"{key.partition('.')[0]} {name.replace('_', ' ')} ({unit})" if unit == "mm" else key


def _alt(document: dict[str, Any], value: str, label: str) -> str:
    best, base = document["best"], document["base"]
    where = ", ".join(f"{key} = {each:g}" for key, each in best["set"].items())
    was = "" if base[value] is None else f"; as given, {level_figure(base[value])}"
    counts = ", ".join(f"{fidelity['designs']} by {fidelity['name']}" for fidelity in document["fidelities"])
    return (
        f"Goal over what was varied ({counts}) and against frequency: best {level_figure(best[value])} {label} at "
        f"{frequency(best['frequency_hz'])} with {where}{was}"
    )
