"""Parts that a scene does not need: suggested by numbers of one run, tried by one run each."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from ..arguments import checked
from ..beam import Beam
from ..constraints import NullSpace
from ..diagnostics import section_strains
from ..errors import CosseratError
from ..export.table import ResultTable, TableRow, provenance
from ..kernels import beam_stress
from ..load import Load
from ..model import Model, Planar, planarity
from ..statics import LoadControl, static
from ..theory import Theory, TheoryInextensible, TheoryKirchhoff, TheoryRigid
from ..time_function import Constant
from ..types import Floats, Meta
from ..warn import Notices
from .scene import Case, Run, Scene

#: energy that may be left out, as a part of what it is compared with, for a trial to be worth it
SLIGHT = 0.01
#: kinds of strain by their numbers
KINDS = {"shear": (0, 1), "extension": (2,), "bending": (3, 4), "torsion": (5,)}


@checked
@dataclass(frozen=True, eq=False)
class Simpler:
    """Parts that a scene does not need; result of :meth:`Answer.simpler`.

    Attributes
    ----------
    rows : list of dict
        One a trial: ``left_out`` (in words), ``because`` (the numbers of the run that suggest it),
        ``change`` (of the values, in tolerances), ``unknowns`` and ``cost_s`` with it, ``saves``
        (part of the processor time of the run; NaN where other kernels ran), ``proposed`` (the
        change fits into what the error leaves of the tolerance), ``reason`` (why it could not be
        run).
    model : Model or None
        The scene with all that is proposed; None where nothing is, or where all of it together
        changes the values by too much.
    step : float
        Step (s) to take with it; NaN where statics do.
    planar : Planar or None
        The plane to freeze it in.
    statics : bool
        Whether equilibria, with the load factor as time, are proposed in place of the motion.
    change, cost_s : float
        By all that is proposed together: of the values (in tolerances) and what the run takes (s),
        by a run of its own.
    notes : dict
        Numbers of the run that suggest what is tried.
    """

    rows: list[TableRow]
    model: Model | None
    step: float
    planar: Planar | None
    statics: bool
    change: float
    cost_s: float
    notes: Meta

    @property
    def table(self) -> ResultTable:
        """The rows, with versions, machine and commit."""
        return ResultTable(self.rows, self.notes | provenance())

    def __repr__(self) -> str:
        return (
            f"<Simpler: {sum(row['proposed'] for row in self.rows)} of {len(self.rows)} proposed>"
        )

    def __str__(self) -> str:
        lines = []
        for row in self.rows:
            verdict = "may go" if row["proposed"] else "stays"
            known = not np.isnan(row["saves"])
            takes = f", the run takes {1 - row['saves']:.2g} times as long" if known else ""
            effect = row["reason"] or (
                f"without, values change by {row['change']:.2g} tolerances, {row['unknowns']}"
                f" unknowns are left{takes}"
            )
            lines.append(f"{row['left_out']} {verdict}: {row['because']}; {effect}")
        together = f"all of it together changes values by {self.change:.2g} tolerances"
        if self.model is not None:
            lines.append(f"{together} and takes {self.cost_s:.2g} s")
        elif any(row["proposed"] for row in self.rows):
            lines.append(f"{together}: too much")
        return "\n".join(lines or ["nothing that could go shows itself in the run"])


class _Trial(NamedTuple):
    """A part that may be left out, and the numbers that suggest it."""

    left_out: str
    because: str
    case: Case
    theories: Mapping[str, Theory] = MappingProxyType({})
    statics: bool = False
    planar: Planar | None = None


def simplified(scene: Scene, run: Run, case: Case, band: Mapping[str, float]) -> Simpler:
    """Try what the numbers of a run suggest, each by one run, then all that fits together."""
    room = 1 - 2 * max(band[name] / scene.asked.tolerance[name] for name in band)
    energies = {name: energies_of(run, name) for name in scene.beams}
    rows = []
    taken = list[_Trial]()
    for trial in _suggested(scene, run, case, energies):
        if trial.theories and any(trial.theories.keys() == each.theories.keys() for each in taken):
            continue  # a simpler theory of these beams does already
        row, _ = _tried(scene, run, trial)
        row["proposed"] = row["change"] <= room
        taken += [trial] * row["proposed"]
        rows.append(row)
    together = _combined(case, taken)
    row, found = _tried(scene, run, together) if taken else ({"change": 0.0}, None)
    fits = found is not None and row["change"] <= room
    notes: Meta = {"kinetic energy (J)": float(run.history["kinetic"].max())}
    for name, parts in energies.items():
        notes[f"energy of {name} (J)"] = {kind: float(each.max()) for kind, each in parts.items()}
    return Simpler(
        rows,
        found.model if found is not None and fits else None,
        float("nan") if together.statics else scene.span / together.case.steps,
        together.planar,
        together.statics,
        row["change"],
        run.cost_s if found is None else found.cost_s,
        notes,
    )


def energies_of(run: Run, name: str) -> dict[str, Floats]:
    """Energy (J) of a beam by kind of strain, at all recorded states.

    The energy of coupled strains counts half to each of them.
    """
    beam = run.model[name]
    assert isinstance(beam, Beam)
    e = beam.elements
    strains = section_strains(run.system, beam, run.history["q"])
    stress = np.array([beam_stress(e, each) for each in strains])
    parts = 0.5 * np.einsum("tegk,tegk,eg->tk", strains, stress, e.lengths[:, None] * e.weights)
    return {kind: parts[:, list(k)].sum(1) for kind, k in KINDS.items()}


def _suggested(
    scene: Scene, run: Run, case: Case, energies: Mapping[str, Mapping[str, Floats]]
) -> list[_Trial]:
    """Trials, those that leave out most first."""
    kinetic = run.history["kinetic"]
    potential = run.history["external"]
    stored = [sum(parts.values()) for parts in energies.values()]
    strained = float(np.max(sum(stored))) if stored else 0.0
    whole = float(np.max(kinetic + abs(potential - potential[0])) + strained)
    trials = []
    if scene.start is None and kinetic.max() <= SLIGHT * strained:
        why = f"kinetic energy is at most {kinetic.max() / strained:.1e} of the strain energy"
        trials.append(_Trial("inertia (statics)", why, case, statics=True))
    for names in _alike(scene):
        energy = {k: sum(energies[n][k] for n in names) for k in KINDS}
        own = sum(energy.values())
        label = ", ".join(names)
        slight = energy["shear"], energy["shear"] + energy["extension"], own
        compared = float(np.max(own)), float(np.max(own)), whole
        choices = (
            ("shear", TheoryKirchhoff()),
            ("extension", TheoryInextensible()),
            ("strains", TheoryRigid()),
        )
        found = []
        for (what, theory), left, size in zip(choices, slight, compared, strict=True):
            part = float(np.max(left)) / size if size else 0.0
            if set(theory.held) > set(scene.beams[names[0]].theory.held) and part <= SLIGHT:
                of = "all energy" if what == "strains" else "their strain energy"
                why = f"at most {part:.1e} of {of}"
                found.append(_Trial(f"{what} of {label}", why, case, dict.fromkeys(names, theory)))
        trials += found[::-1]
    plane = planarity(run.system)
    if plane.planar is not None and scene.start is None:
        why = f"all stays in the plane with normal {plane.plane.normal.round(6).tolist()}"
        trials.append(_Trial("motion out of the plane", why, case, planar=plane.planar))
    if scene.beams and case.parts > 1:
        trials.append(
            _Trial("half of the elements", "meshes are finer than the poorest", case.coarser)
        )
    elif scene.beams and case.order > 1:
        trials.append(
            _Trial(
                "an order of the elements",
                f"it is {case.order}",
                case._replace(order=case.order - 1),
            )
        )
    trials.append(_Trial("every second step", f"there are {case.steps}", case.longer))
    return trials


def _alike(scene: Scene) -> list[list[str]]:
    """Beams of equal sections, theories and lengths together."""
    groups: dict[str, list[str]] = {}
    for name, beam in scene.beams.items():
        length = f"{beam.mesh.lengths.sum():.6g}"
        key = f"{beam.sections} {beam.theory} {length}"
        groups.setdefault(key, []).append(name)
    return list(groups.values())


def _combined(case: Case, trials: Sequence[_Trial]) -> _Trial:
    """All of them in one."""
    theories: dict[str, Theory] = {}
    together = case
    for trial in trials:
        theories |= trial.theories
        for name, new, old in zip(Case._fields, trial.case, case, strict=True):
            together = together._replace(**{name: new}) if new != old else together
    plane = next((trial.planar for trial in trials if trial.planar is not None), None)
    return _Trial("", "", together, theories, any(trial.statics for trial in trials), plane)


def _tried(scene: Scene, run: Run, trial: _Trial) -> tuple[TableRow, Run | None]:
    """The row of a trial, and its run.

    A run that takes longer than the one it is compared with is made twice: the first one of its
    kind waits for compiled kernels.
    """
    row = {"left_out": trial.left_out, "because": trial.because, "change": np.inf}
    row |= {"unknowns": run.system.unknowns, "cost_s": np.nan, "saves": np.nan, "reason": ""}
    try:
        with Notices(quiet=True, alone=True):
            built = scene.frozen(scene.items(trial.case, trial.theories), trial.planar)
            make = partial(_at_rest, scene, run, built)
            if not trial.statics:
                make = partial(scene.run, trial.case, built=built)
            found = make()
            if found.history.status == "interrupted":
                raise KeyboardInterrupt
            if found.cost_s > run.cost_s:
                found = min(found, make(), key=lambda each: each.cost_s)
            apart = found.distances(run)
    except (CosseratError, ArithmeticError) as error:
        return row | {"reason": f"it cannot be run without ({error})"}, None
    sizes = [gap.max(initial=0.0) / scene.asked.tolerance[n] for n, (_, gap) in apart.items()]
    alike = found.history.meta["kernels"] == run.history.meta["kernels"]
    saves = 1 - found.cost_s / run.cost_s if alike else np.nan
    more = {"unknowns": found.system.unknowns, "cost_s": found.cost_s, "saves": saves}
    return row | {"change": float(np.nanmax(sizes))} | more, found


def _at_rest(scene: Scene, run: Run, built: Any) -> Run:
    """Equilibria at the recorded instants of a run: what changes in time takes the load factor."""
    begun = time.process_time()
    model, system, copies = built
    held = {}
    for name in model:
        item = model[name]
        if isinstance(item, Load) and all(isinstance(term.time, Constant) for term in item.made_of):
            held[name] = 1.0
    end = len(run.history) - 1
    # 16 equilibria along the time of the run
    at = run.history.times[np.unique(np.linspace(0, end, 17).round().astype(int))[1:]]
    path = static(system, NullSpace(), LoadControl(at=at.tolist()), factors=held, watch=False)
    return scene.read(Run(model, system, path), copies, begun)
