"""What the schema EAFv3.0.xsd asks of a file, as far as tcfit's files use it.

The facts are those of the schema; it is not here itself, as it comes with ELAN.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator

CHILDREN = {
    "ANNOTATION_DOCUMENT": (
        "LICENSE HEADER TIME_ORDER TIER LINGUISTIC_TYPE LOCALE LANGUAGE CONSTRAINT CONTROLLED_VOCABULARY LEXICON_REF "
        "REF_LINK_SET EXTERNAL_REF"
    ),
    "HEADER": "MEDIA_DESCRIPTOR LINKED_FILE_DESCRIPTOR PROPERTY",
    "TIME_ORDER": "TIME_SLOT",
    "TIER": "ANNOTATION",
    "ANNOTATION": "ALIGNABLE_ANNOTATION REF_ANNOTATION",
    "ALIGNABLE_ANNOTATION": "ANNOTATION_VALUE",
    "REF_ANNOTATION": "ANNOTATION_VALUE",
    "CONTROLLED_VOCABULARY": "DESCRIPTION CV_ENTRY_ML",
    "CV_ENTRY_ML": "CVE_VALUE",
}
"""Which elements an element may hold, in this order."""
_SAID = "ANNOTATION_ID! EXT_REF LANG_REF CVE_REF"
ATTRIBUTES = {
    "ANNOTATION_DOCUMENT": "DATE! AUTHOR! VERSION! FORMAT xmlns:xsi xsi:noNamespaceSchemaLocation",
    "HEADER": "MEDIA_FILE TIME_UNITS",
    "MEDIA_DESCRIPTOR": "MEDIA_URL! RELATIVE_MEDIA_URL MIME_TYPE! TIME_ORIGIN EXTRACTED_FROM",
    "PROPERTY": "NAME",
    "TIME_ORDER": "",
    "TIME_SLOT": "TIME_SLOT_ID! TIME_VALUE",
    "TIER": "TIER_ID! PARTICIPANT ANNOTATOR LINGUISTIC_TYPE_REF! DEFAULT_LOCALE PARENT_REF EXT_REF LANG_REF",
    "ANNOTATION": "",
    "ALIGNABLE_ANNOTATION": f"{_SAID} TIME_SLOT_REF1! TIME_SLOT_REF2! SVG_REF",
    "REF_ANNOTATION": f"{_SAID} ANNOTATION_REF! PREVIOUS_ANNOTATION",
    "ANNOTATION_VALUE": "",
    "LINGUISTIC_TYPE": (
        "LINGUISTIC_TYPE_ID! TIME_ALIGNABLE CONSTRAINTS GRAPHIC_REFERENCES CONTROLLED_VOCABULARY_REF EXT_REF "
        "LEXICON_REF"
    ),
    "LANGUAGE": "LANG_ID! LANG_DEF LANG_LABEL",
    "CONSTRAINT": "STEREOTYPE! DESCRIPTION",
    "CONTROLLED_VOCABULARY": "CV_ID! EXT_REF",
    "CV_ENTRY_ML": "CVE_ID! EXT_REF",
    "CVE_VALUE": "LANG_REF! DESCRIPTION",
}
"""Those that an element may have; with ! it must."""
REFERENCES = {
    "PARENT_REF": ("TIER", "TIER_ID"),
    "LINGUISTIC_TYPE_REF": ("LINGUISTIC_TYPE", "LINGUISTIC_TYPE_ID"),
    "CONTROLLED_VOCABULARY_REF": ("CONTROLLED_VOCABULARY", "CV_ID"),
    "TIME_SLOT_REF1": ("TIME_SLOT", "TIME_SLOT_ID"),
    "TIME_SLOT_REF2": ("TIME_SLOT", "TIME_SLOT_ID"),
    "LANG_REF": ("LANGUAGE", "LANG_ID"),
    "CONSTRAINTS": ("CONSTRAINT", "STEREOTYPE"),
    "CVE_REF": ("CV_ENTRY_ML", "CVE_ID"),
    "ANNOTATION_REF": ("*", "ANNOTATION_ID"),
}
"""What an attribute names must be there, once."""
_UNIQUE = ("TIER_ID", "LINGUISTIC_TYPE_ID", "CV_ID", "TIME_SLOT_ID", "LANG_ID", "STEREOTYPE", "CVE_ID", "ANNOTATION_ID")
_IDS = ("TIME_SLOT_ID", "ANNOTATION_ID", "LANG_ID", "STEREOTYPE")
"""Those of the type xsd:ID, which are names and of which there is each only once in a file."""


def problems(root: ET.Element) -> Iterator[str]:
    """What is against the schema; nothing if all is well. `root` is to be parsed without namespaces."""
    if root.tag != "ANNOTATION_DOCUMENT" or len(root.findall("HEADER")) != 1 or len(root.findall("TIME_ORDER")) != 1:
        yield "no document with one header and one order of time"
    for element in root.iter():
        order = CHILDREN.get(element.tag, "").split()
        places = [order.index(child.tag) if child.tag in order else -1 for child in element]
        if -1 in places or places != sorted(places):
            yield f"<{element.tag}> holds {[child.tag for child in element]}"
        allowed = ATTRIBUTES[element.tag].split()
        if missing := [name for name in allowed if name.endswith("!") and name[:-1] not in element.attrib]:
            yield f"<{element.tag}> has no {missing}"
        if more := [name for name in element.attrib if name not in [a.rstrip("!") for a in allowed]]:
            yield f"<{element.tag}> has {more}"
        for name, (tag, key) in REFERENCES.items():
            if name in element.attrib and element.get(name) not in {
                e.get(key) for e in root.iter(tag if tag != "*" else None)
            }:
                yield f"<{element.tag}> has {name}={element.get(name)}, which is not there"
    for name in _UNIQUE:
        values = [element.get(name) for element in root.iter() if name in element.attrib]
        if len(set(values)) != len(values):
            yield f"{name} is there twice"
    ids = [element.get(name, "") for element in root.iter() for name in _IDS if name in element.attrib]
    if len(set(ids)) != len(ids) or not all(re.fullmatch(r"[A-Za-z_][\w.-]*", i) for i in ids):
        yield "ids are no names, or there twice"
    if not all(slot.get("TIME_VALUE", "").isdecimal() for slot in root.iter("TIME_SLOT")):
        yield "a time is no whole number from 0 on"
