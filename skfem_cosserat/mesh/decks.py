"""Lines of decks of Abaqus and Nastran, which hold whole models.

Nodes, lines and sets are read, and what cannot change them is counted. Anything else is an error
with its line: no keyword or card that is not listed here is passed by.
"""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import MeshError


@dataclass(eq=False)
class Deck:
    """Mesh of a deck, with the numbers that it gives to nodes and elements.

    Attributes
    ----------
    nodes : dict of int to list of float
        Coordinates (m).
    lines : dict of int to list of int
        Both nodes of each element that is a line.
    node_sets, line_sets : dict of str to set of int
        Members of sets; there may be others among them that the deck does not have.
    left : Counter of str
        What is not read, and how often it occurs.
    """

    nodes: dict[int, list[float]] = field(default_factory=dict)
    lines: dict[int, list[int]] = field(default_factory=dict)
    node_sets: dict[str, set[int]] = field(default_factory=dict)
    line_sets: dict[str, set[int]] = field(default_factory=dict)
    left: Counter[str] = field(default_factory=Counter)


def _add(known: dict[int, Any], number: str, value: Any) -> int:
    """Take a node or an element."""
    if int(number) in known:
        raise ValueError(f"number {number} is given twice")
    known[int(number)] = value
    return int(number)


def _place(words: list[str]) -> list[float]:
    """Coordinates; one that is left out is zero."""
    return [_real(word) for word in [*words, "", ""][:3]]


def _real(word: str) -> float:
    """A number as Fortran writes it, such as 1.5, 1.5D+3 or 1.5+3; nothing is zero."""
    return float(re.sub(r"(?<=[\d.])(?=[+-])", "E", word.upper().replace("D", "E")) or "0")


@contextlib.contextmanager
def _at(place: str) -> Iterator[None]:
    """Say of errors where in the deck they are."""
    try:
        yield
    except ValueError as error:
        raise MeshError(place, str(error)) from error


_UNKNOWN = "is not understood, and may change nodes or elements: write all of them out"
_QUADRATIC = "is a quadratic line; only lines with two nodes are read: mesh with order 1"


def _rows(file: Path) -> list[tuple[int, str]]:
    """Rows of a text with their numbers."""
    return [*enumerate(file.read_text(encoding="utf-8", errors="replace").splitlines(), start=1)]


# -- Abaqus, CalculiX ------------------------------------------------------------------------------

_LINES = re.compile(r"(B[23][13](OS)?|PIPE[23]1|ELBOW31[BC]?|T[23]D2|FRAME[23]D)[HRTE]*")
_LINES_OF_THREE = re.compile(r"(B[23]2(OS)?|PIPE[23]2|ELBOW32|T[23]D3)[HRTE]*")
#: Keywords that are read, with the parameters that are understood.
_READ = {
    "NODE": "NSET",
    "ELEMENT": "TYPE ELSET",
    "NSET": "NSET GENERATE INSTANCE INTERNAL UNSORTED",
    "ELSET": "ELSET GENERATE INSTANCE INTERNAL UNSORTED",
    "HEADING": "SPARSE",
    "PREPRINT": "CONTACT ECHO HISTORY MODEL PARSUBSTITUTION PARVALUES",
    "ASSEMBLY": "NAME",
    "PART": "NAME",
    "INSTANCE": "NAME PART",
    **dict.fromkeys(("ENDASSEMBLY", "ENDPART", "ENDINSTANCE", "ENDSTEP"), ""),
}
#: Keywords before the first step that leave nodes and elements as they are.
_BESIDE = re.compile(
    r"(BEAMGENERAL|BEAM|CONNECTOR|FRAME|MEMBRANE|SHELLGENERAL|SHELL|SOLID)SECTION|"
    r"CONNECTOR(BEHAVIOR|DAMPING|ELASTICITY)|CONTACT(INCLUSIONS|PAIR|PROPERTYASSIGNMENT)?|"
    r"(DISTRIBUTING|KINEMATIC)?COUPLING|DISTRIBUTING|KINEMATIC|DISTRIBUTION(TABLE)?|"
    r"SURFACE(BEHAVIOR|INTERACTION)?|"
    r"SECTION(CONTROLS|POINTS)|TRANSVERSESHEAR(STIFFNESS)?|(BEAMADDED|ROTARY)INERTIA|"
    r"(NONSTRUCTURAL)?MASS|CENTROID|SHEARCENTER|NORMAL|ORIENTATION|TRANSFORM|"
    r"AMPLITUDE|BOUNDARY|CLEARANCE|DASHPOT|EQUATION|FRICTION|GAP|HOURGLASSSTIFFNESS|"
    r"INITIALCONDITIONS|MPC|PHYSICALCONSTANTS|RELEASE|RESTART|RIGIDBODY|SPRING|STEP|TIE|TIMEPOINTS|"
    r"MATERIAL|CONDUCTIVITY|CREEP|DAMPING|DENSITY|DEPVAR|ELASTIC|EXPANSION|HYPERELASTIC|PLASTIC|"
    r"SPECIFICHEAT|USERMATERIAL|VISCOELASTIC|[CD]LOAD|DSLOAD|TEMPERATURE|"
    r"(NODE|ELEMENT|EL|CONTACT)?(FILE|PRINT|OUTPUT)"
)


@dataclass(eq=False)
class Keyword:
    """A keyword of Abaqus with its parameters and the words of its data lines."""

    shown: str
    place: str
    options: dict[str, str]
    rows: list[list[str]]

    @property
    def name(self) -> str:
        """The keyword in capitals, without blanks."""
        return self.shown.replace(" ", "")


def _add_keywords(file: Path, found: list[Keyword]) -> None:
    """Keywords of a file and, at their place, of those that it includes."""
    head = ""
    for number, row in _rows(file):
        row = row.strip()
        if not row or row.startswith("**"):
            continue
        if not (head or row.startswith("*")):
            if not found:
                raise MeshError(f"line {number}", f"{row!r} stands before the first keyword")
            found[-1].rows.append([word.strip() for word in row.split(",")])
            continue
        head += row
        if head.endswith(","):  # it goes on in the next line
            continue
        name, *words = head.split(",")
        pairs = [word.partition("=") for word in words]
        options = {"".join(key.upper().split()): text.strip(' "') for key, _, text in pairs}
        name = " ".join(name.upper().strip("*").split())
        head = ""
        if name == "INCLUDE":
            _add_keywords(file.parent / options.get("INPUT", ""), found)
        else:
            found.append(Keyword(name, f"line {number}: *{name}", options, []))


def read_abaqus(file: Path) -> Deck:
    """Read a deck of at most one part, which is not moved."""
    keywords: list[Keyword] = []
    _add_keywords(file, keywords)
    count = Counter(keyword.name for keyword in keywords)
    for name in ("PART", "INSTANCE", "ASSEMBLY", "STEP"):
        if count[name] > count[f"END{name}"]:
            raise MeshError(f"*{name}", f"has no *END {name}: the file is cut short")
    if count["PART"] > 1 or count["INSTANCE"] > 1:
        text = f"{count['PART']} parts, {count['INSTANCE']} instances: each has nodes of its own"
        raise MeshError("*PART", f"{text}, and only one is read")
    deck = Deck()
    steps = False
    for keyword in keywords:
        steps |= keyword.name == "STEP"
        if keyword.name in _READ:
            for option in keyword.options.keys() - set(_READ[keyword.name].split()):
                raise MeshError(f"{keyword.place}, {option}", _UNKNOWN)
        elif steps or _BESIDE.fullmatch(keyword.name):
            deck.left[f"*{keyword.shown}"] += 1
        else:
            raise MeshError(keyword.place, _UNKNOWN)
    keywords.sort(key=lambda keyword: keyword.name.endswith("SET"))  # a range is of what there is
    for keyword in keywords:
        with _at(keyword.place):
            _read_keyword(deck, keyword.name, keyword.options, keyword.rows)
    return deck


def _read_keyword(deck: Deck, name: str, options: dict[str, str], rows: list[list[str]]) -> None:
    """Take nodes, elements, or members of a set: numbers, ranges, or other sets."""
    nodes = name in ("NODE", "NSET")
    sets = deck.node_sets if nodes else deck.line_sets
    known = deck.nodes if nodes else deck.lines
    members = _members(sets, options.get("NSET" if nodes else "ELSET", ""))
    kind = options.get("TYPE", "").upper()
    if _LINES_OF_THREE.fullmatch(kind):
        raise ValueError(f"TYPE={kind} {_QUADRATIC}")
    if name == "ELEMENT" and not _LINES.fullmatch(kind):
        deck.left[f"*ELEMENT of type {kind}"] += 1
        return
    for row in rows:
        words = [word for word in row if word]
        if name == "INSTANCE" and any(map(_real, row)):
            raise ValueError("moves its part, which is not read: give nodes where they are")
        if name == "NODE":
            members.add(_add(deck.nodes, row[0], _place(row[1:])))
        elif name == "ELEMENT":
            # A third node is for the orientation. meshio calls lines of three nodes B33, though.
            if len(words) not in (3, 3 if kind.startswith("B33") else 4):
                raise ValueError(f"element {row[0]} has {len(words) - 1} nodes")
            members.add(_add(deck.lines, row[0], [*map(int, words[1:3])]))
        elif "GENERATE" in options:
            first, last, step = [*map(int, words), 1][:3]
            members |= {k for k in known if k in range(first, last + 1, step)}
        elif name in ("NSET", "ELSET"):
            for word in words:
                number = word.rpartition(".")[2]  # behind the name of an instance
                members |= {int(number)} if number.isdigit() else _members(sets, number)


def _members(sets: dict[str, set[int]], name: str) -> set[int]:
    """Members of a set, which has one name in whatever letters it is written."""
    return sets.setdefault(next((k for k in sets if k.upper() == name.upper()), name), set())


# -- Nastran ---------------------------------------------------------------------------------------

#: Lines, and the field of their first node.
_BARS = {"CBAR": 2, "CBEAM": 2, "CROD": 2, "CTUBE": 2, "CONROD": 1}
#: Cards that leave nodes and lines as they are: properties, materials, other elements, systems of
#: coordinates (a GRID that is given in one is refused), supports, loads, cases.
_CARDS = re.compile(
    r"P(BAR|BEAM|ROD|TUBE|SHELL|SOLID|LSOLID|COMP|BUSH|ELAS|DAMP|MASS|GAP|VISC|SHEAR|LOAD)\w*|"
    r"MAT\w+|C(QUAD|TRI|TETRA|HEXA|PENTA|PYRA|SHEAR|BUSH|ELAS|DAMP|MASS|VISC|GAP|WELD|FAST)\w*|"
    r"CONM[12]|PLOTEL|RBE[123]|RBAR1?|RROD|MPC(ADD)?|SPC(1|ADD|D)?|SUPORT1?|[ABCQ]SET1?|CORD[12]\w|"
    r"BAROR|BEAMOR|SPOINT|EPOINT|PARAM|MDLPRM|EIG\w+|FREQ\d?|TSTEP(NL)?|NLPARM|[TRD]LOAD[12]?|"
    r"D(AREA|ELAY|PHASE)|LOAD|LSEQ|FORCE\d?|MOMENT\d?|GRAV|ACCEL1?|RFORCE|TEMP\w*|TABLE\w+|SET\d"
)


def read_nastran(file: Path) -> Deck:
    """Read bulk data, which begin at BEGIN BULK if there is such a line."""
    rows = _rows(file)
    begins = [number for number, row in rows if row.upper().split() == ["BEGIN", "BULK"]]
    deck = Deck()
    for place, name, *words in _cards(rows[begins[0] if begins else 0 :]):
        with _at(f"{place}: {name}"):
            if name == "GRID" and words[1] in ("", "0"):
                _add(deck.nodes, words[0], _place(words[2:5]))
                deck.left["CD or PS of GRID"] += any(map(_real, words[5:7]))
            elif name == "GRID":
                text = f"node {words[0]} is given in the system {words[1]}, which is not read"
                raise ValueError(f"{text}: give it in the basic system")
            elif name in _BARS:
                _read_bar(deck, name, words)
            elif name == "CBEAM3":
                raise ValueError(_QUADRATIC)
            elif _CARDS.fullmatch(name) or (name == "GRDSET" and words[1] in ("", "0")):
                deck.left[name] += 1
            else:
                raise ValueError(_UNKNOWN)
    return deck


def _cards(rows: list[tuple[int, str]]) -> list[list[str]]:
    """Place, name and words of each card up to ENDDATA, in any of the three formats."""
    cards: list[list[str]] = []
    for number, text in rows:
        row = text.partition("$")[0].rstrip().expandtabs(8).upper()
        if row.startswith("ENDDATA"):
            return cards
        head, free, rest = row.partition(",")
        head = (head if free else row[:8]).strip()
        count = 4 if "*" in head else 8
        width = 64 // count
        words = rest.split(",") if free else [row[k : k + width] for k in range(8, 72, width)]
        if len(words) > count + 1:
            raise MeshError(f"line {number}", f"{len(words)} fields, expected at most {count + 1}")
        if head[:1] not in ("", "+", "*"):
            cards.append([f"line {number}", head.rstrip("* ")])
        if cards and row:
            cards[-1] += map(str.strip, [*words, *[""] * count][:count])
    raise MeshError("ENDDATA", "is missing: the file is cut short, or give it this last line")


def _read_bar(deck: Deck, name: str, words: list[str]) -> None:
    """Lines: number, property, nodes; of CBAR and CBEAM orientation, pins, offsets, too."""
    _add(deck.lines, words[0], [*map(int, words[_BARS[name] : _BARS[name] + 2])])
    deck.left["property ids"] += 1
    if name in ("CBAR", "CBEAM"):
        deck.left["orientations of CBAR and CBEAM"] += 1
        deck.left["pins of CBAR and CBEAM"] += any(words[8:10])
        if any(map(_real, words[10:16])):
            raise ValueError(f"element {words[0]} has offsets of its ends, which are not read")


#: Reader of a deck by the suffix of its file.
DECKS: dict[str, Callable[[Path], Deck]] = {
    ".inp": read_abaqus,
    **dict.fromkeys((".bdf", ".fem", ".nas"), read_nastran),
}
