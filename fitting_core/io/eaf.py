"""ELAN's annotation files (.eaf), version 3.0.

Follows the schema EAFv3.0.xsd of the Max Planck Institute for Psycholinguistics, and "ELAN Annotation Format: EAF
schema description" (Sloetjes and Hulsbosch). Files of earlier versions are read as well.

Not read by pympi-ling: 1.71 ignores media's origins in time and times that follow from other annotations, and needs
numbers in ids.
"""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from mimetypes import guess_type
from pathlib import Path, PurePosixPath
from urllib.parse import unquote
from xml.parsers import expat

from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file

SUFFIX = ".eaf"
_MOST_BYTES = 200 * 2**20
_SCHEMA = "http://www.mpi.nl/tools/elan/EAFv3.0.xsd"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_LANGUAGE = {"LANG_DEF": "http://cdb.iso.org/lg/CDB-00138502-001", "LANG_ID": "eng", "LANG_LABEL": "English (eng)"}
"""Of the vocabularies' words, as ELAN writes it."""
_NEVER = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML cannot contain."""
_WHOLE = re.compile(r"-?[0-9]{1,11}")
_STEREOTYPES = {
    "Time_Subdivision": "Time subdivision of parent annotation's time interval, no time gaps allowed within this "
    "interval",
    "Symbolic_Subdivision": "Symbolic subdivision of a parent annotation. Annotations refering to the same parent are "
    "ordered",
    "Symbolic_Association": "1-1 association with a parent annotation",
    "Included_In": "Time alignable annotations within the parent annotation's time interval, gaps are allowed",
}
"""As ELAN writes them into every file."""


@dataclass(frozen=True, kw_only=True)
class Annotation:
    """A text about a stretch of time."""

    start: int
    """Milliseconds from the beginning of the video."""
    end: int
    """Milliseconds; after `start`."""
    text: str


@dataclass(frozen=True, kw_only=True)
class Tier:
    """Annotations of one kind, ordered by time. In files of tcfit they do not overlap."""

    name: str
    kind: str = ""
    """What tiers of one kind share: the vocabulary, and whether they have a parent. ELAN: linguistic type."""
    annotations: tuple[Annotation, ...]
    vocabulary: Mapping[str, str] = field(default_factory=dict)
    """The only texts that the tier may have, each with its meaning; empty: any text."""
    parent: str = ""
    """Name of the parent tier, with one annotation for each of these at the same time; empty: no parent."""


# --- writing ---


def write_eaf(path: Path, tiers: Sequence[Tier], *, media: Path | None = None) -> None:
    """Write an .eaf file.

    Args:
        path: The file.
        tiers: In display order; a parent comes before its children. Annotations of one tier must
            not overlap, which ELAN does not allow.
        media: The video, linked by its absolute path and as a file beside this one; None: no video is linked.
    """
    root = ET.Element("ANNOTATION_DOCUMENT", {
        "AUTHOR": "tcfit", "DATE": datetime.now(UTC).isoformat(timespec="seconds"), "FORMAT": "3.0", "VERSION": "3.0",
        "xmlns:xsi": _XSI, "xsi:noNamespaceSchemaLocation": _SCHEMA,
    })  # fmt: skip
    header = ET.SubElement(root, "HEADER", {"MEDIA_FILE": "", "TIME_UNITS": "milliseconds"})
    if media is not None:
        kind = guess_type(media.name)[0] or "unknown"
        urls = {"MEDIA_URL": media.resolve().as_uri(), "RELATIVE_MEDIA_URL": "./" + _quoted(media)}
        ET.SubElement(header, "MEDIA_DESCRIPTOR", {**urls, "MIME_TYPE": kind})
    used = ET.SubElement(header, "PROPERTY", {"NAME": "lastUsedAnnotationId"})
    used.text = str(sum(len(tier.annotations) for tier in tiers))
    _write_tiers(root, tiers, _write_times(root, tiers))
    _write_types(root, tiers)
    ET.indent(root, "    ")
    path.write_bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")


def _quoted(media: Path) -> str:
    return media.resolve().as_uri().rpartition("/")[2]


def _write_times(root: ET.Element, tiers: Sequence[Tier]) -> dict[int, str]:
    """The time slots by their milliseconds, ordered by time."""
    ends = {time for tier in tiers for a in tier.annotations if not tier.parent for time in (a.start, a.end)}
    slots = {time: f"ts{n}" for n, time in enumerate(sorted(ends), 1)}
    order = ET.SubElement(root, "TIME_ORDER")
    for time, name in slots.items():
        ET.SubElement(order, "TIME_SLOT", {"TIME_SLOT_ID": name, "TIME_VALUE": str(time)})
    return slots


def _write_tiers(root: ET.Element, tiers: Sequence[Tier], slots: Mapping[int, str]) -> None:
    written: dict[str, dict[int, str]] = {}  # by tier, the annotation that starts at a time
    number = 0
    for tier in tiers:
        about = {"LINGUISTIC_TYPE_REF": tier.kind, "TIER_ID": tier.name}
        element = ET.SubElement(root, "TIER", about | ({"PARENT_REF": tier.parent} if tier.parent else {}))
        for annotation in tier.annotations:
            number += 1
            name = f"a{number}"
            written.setdefault(tier.name, {})[annotation.start] = name
            if tier.parent:
                ends = {"ANNOTATION_REF": written[tier.parent][annotation.start]}
            else:
                ends = {"TIME_SLOT_REF1": slots[annotation.start], "TIME_SLOT_REF2": slots[annotation.end]}
            kind = "REF_ANNOTATION" if tier.parent else "ALIGNABLE_ANNOTATION"
            said = {"CVE_REF": _entry(tier, annotation.text)} if annotation.text in tier.vocabulary else {}
            held = ET.SubElement(ET.SubElement(element, "ANNOTATION"), kind, {"ANNOTATION_ID": name, **said, **ends})
            ET.SubElement(held, "ANNOTATION_VALUE").text = _NEVER.sub("\N{REPLACEMENT CHARACTER}", annotation.text)


def _entry(tier: Tier, text: str) -> str:
    """The id of an entry of the tier's vocabulary."""
    return f"{tier.kind}: {text}"


def _write_types(root: ET.Element, tiers: Sequence[Tier]) -> None:
    """The linguistic types of the tiers, and what they refer to, in the schema's order."""
    kinds = {tier.kind: tier for tier in tiers}
    for kind, tier in kinds.items():
        about = {"GRAPHIC_REFERENCES": "false", "LINGUISTIC_TYPE_ID": kind}
        about["TIME_ALIGNABLE"] = "false" if tier.parent else "true"
        about |= {"CONSTRAINTS": "Symbolic_Association"} if tier.parent else {}
        about |= {"CONTROLLED_VOCABULARY_REF": kind} if tier.vocabulary else {}
        ET.SubElement(root, "LINGUISTIC_TYPE", about)
    ET.SubElement(root, "LANGUAGE", _LANGUAGE)
    for name, text in _STEREOTYPES.items():
        ET.SubElement(root, "CONSTRAINT", {"DESCRIPTION": text, "STEREOTYPE": name})
    for kind, tier in kinds.items():
        if tier.vocabulary:
            held = ET.SubElement(root, "CONTROLLED_VOCABULARY", {"CV_ID": kind})
            for value, meaning in tier.vocabulary.items():
                entry = ET.SubElement(held, "CV_ENTRY_ML", {"CVE_ID": _entry(tier, value)})
                said = ET.SubElement(entry, "CVE_VALUE", {"LANG_REF": _LANGUAGE["LANG_ID"], "DESCRIPTION": meaning})
                said.text = value


# --- reading ---


def read_eaf(path: Path, video: str = "") -> tuple[Tier, ...]:
    """The tiers of an .eaf file in file order, with the time in the video of all annotations. Raises InputError if it
    cannot be read, is not an .eaf file, or is inconsistent; or it links videos that begin at different times, and none
    of this name.

    ELAN counts from each medium's origin (TIME_ORIGIN): that of the linked file with the video's name (any suffix),
    otherwise that of all linked videos.

    Annotations that only refer to others take the time of those; several that refer to the same one share it evenly, as
    in ELAN. So do consecutive annotations whose inner time slots have no time.

    Args:
        path: The file.
        video: The name of the file whose time counts.
    """
    try:
        content = regular_file(path, most=_MOST_BYTES).read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}). Give an .eaf file of ELAN.") from error
    try:
        root = _parsed(content)
        if root.tag != "ANNOTATION_DOCUMENT":
            raise ValueError(f"its outermost element is <{root.tag[:40]}>, expected <ANNOTATION_DOCUMENT>")
        return _Document(root, video).tiers()
    except (ValueError, expat.ExpatError) as error:
        raise InputError(f"{path}: is not a readable .eaf file: {error}. Open it in ELAN and save it.") from error


def _parsed(content: bytes) -> ET.Element:
    """XML without a document type, which entities need: they could fill the memory or read files."""
    builder, parser = ET.TreeBuilder(), expat.ParserCreate()

    def refuse(*_: object) -> None:
        raise ValueError("it has a document type (<!DOCTYPE>), which ELAN's files never have")

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler = builder.data
    parser.buffer_text = True
    parser.Parse(content, True)
    return builder.close()


_Span = tuple[float, float]


class _Document:
    """An .eaf file's elements, by the names with which they refer to each other."""

    def __init__(self, root: ET.Element, video: str) -> None:
        header = root.find("HEADER")
        units = "milliseconds" if header is None else header.get("TIME_UNITS", "milliseconds")
        if units != "milliseconds":
            raise ValueError(f"its times are in {units}, expected milliseconds")
        self.origin = _origin(root.findall("HEADER/MEDIA_DESCRIPTOR"), video)
        self.elements = root.findall("TIER")
        self.slots = {_of(slot, "TIME_SLOT_ID"): _time(slot) for slot in root.iterfind("TIME_ORDER/TIME_SLOT")}
        self.held = {_of(tier, "TIER_ID"): [_held(a) for a in tier.findall("ANNOTATION")] for tier in self.elements}
        self.spans: dict[str, _Span] = {}
        """By id, the times of annotations known so far."""

    def tiers(self) -> tuple[Tier, ...]:
        for annotations in self.held.values():
            self._align(annotations)
        self._refer()
        return tuple(self._tier(element) for element in self.elements)

    def _tier(self, element: ET.Element) -> Tier:
        name = _of(element, "TIER_ID")
        found = []
        for held in self.held[name]:
            start, end = self.spans[_of(held, "ANNOTATION_ID")]
            if end < start:
                raise ValueError(f"annotation {_of(held, 'ANNOTATION_ID')} ends before it starts")
            text = held.findtext("ANNOTATION_VALUE") or ""
            found.append(Annotation(start=self.origin + round(start), end=self.origin + round(end), text=text))
        found.sort(key=lambda annotation: (annotation.start, annotation.end))
        return Tier(name=name, annotations=tuple(found), parent=element.get("PARENT_REF", ""))

    def _align(self, annotations: list[ET.Element]) -> None:
        """Times of a tier's annotations with time slots. A chain is a run joined by slots without a time."""
        chain: list[ET.Element] = []
        for held in (a for a in annotations if a.tag == "ALIGNABLE_ANNOTATION"):
            if chain and _of(chain[-1], "TIME_SLOT_REF2") != _of(held, "TIME_SLOT_REF1"):
                self._divide(chain)
                chain = []
            chain.append(held)
            if self._slot(held, "TIME_SLOT_REF2") is not None:
                self._divide(chain)
                chain = []
        self._divide(chain)

    def _divide(self, chain: list[ET.Element]) -> None:
        if not chain:
            return
        start, end = self._slot(chain[0], "TIME_SLOT_REF1"), self._slot(chain[-1], "TIME_SLOT_REF2")
        if start is None or end is None:
            raise ValueError(f"annotation {_of(chain[0], 'ANNOTATION_ID')} has no time")
        for held, span in zip(chain, _shares((start, end), len(chain)), strict=True):
            self.spans[_of(held, "ANNOTATION_ID")] = span

    def _slot(self, held: ET.Element, which: str) -> int | None:
        name = _of(held, which)
        if name not in self.slots:
            raise ValueError(f"annotation {_of(held, 'ANNOTATION_ID')} is at time slot {name}, which is not there")
        return self.slots[name]

    def _refer(self) -> None:
        """Times of annotations that refer to others, starting from those whose parents are known."""
        waiting: dict[str, dict[str, list[ET.Element]]] = {}  # by the parent's id and the children's tier
        for tier, annotations in self.held.items():
            for held in annotations:
                if held.tag == "REF_ANNOTATION":
                    waiting.setdefault(_of(held, "ANNOTATION_REF"), {}).setdefault(tier, []).append(held)
        known = list(self.spans)
        for parent in known:  # which grows meanwhile
            for children in waiting.pop(parent, {}).values():
                for held, span in zip(_in_order(children), _shares(self.spans[parent], len(children)), strict=True):
                    self.spans[_of(held, "ANNOTATION_ID")] = span
                    known.append(_of(held, "ANNOTATION_ID"))
        for parent, lost in waiting.items():
            child = next(iter(lost.values()))[0]
            raise ValueError(f"annotation {_of(child, 'ANNOTATION_ID')} belongs to {parent}, which has no time")


def _origin(media: list[ET.Element], video: str) -> int:
    """Milliseconds of the video at which the file's time begins."""
    named = [m for m in media if _stem(_of(m, "MEDIA_URL")) == _stem(video)]
    found = named or [m for m in media if m.get("MIME_TYPE", "").startswith("video")] or media
    origins = {_stem(_of(m, "MEDIA_URL")): m.get("TIME_ORIGIN", "0") for m in found}
    if len(set(origins.values())) > 1:
        begun = ", ".join(f"{name} at {origin[:12]} ms" for name, origin in origins.items())
        raise ValueError(
            f"the media that it links begin at different times ({begun[:200]}), and none is named as the clip's video "
            f"{video or '(none)'}"
        )
    origin = next(iter(origins.values()), "0")
    if not _WHOLE.fullmatch(origin):
        raise ValueError(f"a medium begins at {origin[:20]!r}, expected whole milliseconds")
    return int(origin)


def _stem(url: str) -> str:
    return PurePosixPath(unquote(url).replace("\\", "/")).stem.casefold()


def _of(element: ET.Element, name: str) -> str:
    value = element.get(name)
    if value is None:
        raise ValueError(f"a <{element.tag}> has no {name}")
    return value


def _time(slot: ET.Element) -> int | None:
    value = slot.get("TIME_VALUE")
    if value is None:
        return None
    if not _WHOLE.fullmatch(value) or int(value) < 0:
        raise ValueError(f"time slot {_of(slot, 'TIME_SLOT_ID')} is at {value[:20]!r}, expected whole milliseconds")
    return int(value)


def _held(annotation: ET.Element) -> ET.Element:
    kinds = ("ALIGNABLE_ANNOTATION", "REF_ANNOTATION")
    if len(annotation) != 1 or annotation[0].tag not in kinds:
        raise ValueError(f"an <ANNOTATION> holds {[child.tag for child in annotation][:3]}, expected one of {kinds}")
    return annotation[0]


def _shares(span: _Span, count: int) -> list[_Span]:
    start, end = span
    each = (end - start) / count
    return [(start + k * each, start + (k + 1) * each) for k in range(count)]


def _in_order(children: list[ET.Element]) -> list[ET.Element]:
    """Elements that name a predecessor come after it; the others keep the file's order."""
    after = {child.get("PREVIOUS_ANNOTATION"): child for child in children}
    found: dict[str, ET.Element] = {}
    for first in children:
        following = first if first.get("PREVIOUS_ANNOTATION") is None else None
        while following is not None and _of(following, "ANNOTATION_ID") not in found:
            found[_of(following, "ANNOTATION_ID")] = following
            following = after.get(_of(following, "ANNOTATION_ID"))
    return [*found.values(), *(child for child in children if _of(child, "ANNOTATION_ID") not in found)]


# --- times of frames: frame f is shown from f / rate seconds until the next one ---

_ROUNDING = 0.5
"""Rounding error of a whole number of milliseconds."""
_TINY = 1e-6


def milliseconds_of(frames: range, frame_rate: float) -> tuple[int, int]:
    """When frames begin to be shown, and when they end.

    Args:
        frames: Their numbers in the video, at least one.
        frame_rate: Frames per second.
    """
    return round(1000 * frames.start / frame_rate), round(1000 * frames.stop / frame_rate)


def frames_of(start: float, end: float, frame_rate: float) -> range:
    """The frames shown in a stretch of time, at least one; the inverse of `milliseconds_of`.

    Args:
        start: Milliseconds.
        end: Milliseconds.
        frame_rate: Frames per second.
    """
    first = math.floor((start + _ROUNDING) * frame_rate / 1000 + _TINY)
    stop = math.ceil((end - _ROUNDING) * frame_rate / 1000 - _TINY)
    return range(first, max(stop, first + 1))
