"""Tuning: Optuna searches settings on some scans; others, which it never saw, say whether the winner is any better."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from scenarios.document import BadInput
from scenarios.run_folder import whole_file
from scenarios.settings_yaml import settings_yaml
from scenarios.study.code import code_version
from scenarios.study.conduct import MAKE, Report, Say
from scenarios.study.gather import Mean, mean_of
from scenarios.study.ledger import only_parent
from scenarios.study.plain import canonical
from scenarios.study.plan import Recipe, differences
from scenarios.study.study import Scene, Study
from scenarios.study.tune_bench import RECORD, Bench, Scores, setting_at, values_of
from scenarios.study.tune_file import POINTS, Tuning, choices, is_number_range, load_tuning

STORE = "tuning.sqlite"
METHOD_FILE, RESULT_FILE, PAGE_FILE = "method.yaml", "tuning.json", "tuning.html"
DIGITS = 6  # of a searched number: more cannot matter, and are hard to read in a settings file
FOLDER = "tunings"


class Trial(NamedTuple):
    """One setting that was looked at to the end: its means on the scans tuned on."""

    number: int
    settings: dict[str, Any]
    values: tuple[float, ...]


@dataclass(frozen=True)
class Verdict:
    """Winner less default on the hold-out, by objective, and in words whether that is more than noise."""

    fidelity: str
    default: dict[str, Mean]
    winner: dict[str, Mean]
    difference: dict[str, Mean]
    words: str


@dataclass(frozen=True)
class Tuned:
    """How a tuning ended."""

    folder: Path
    settings: dict[str, Any]
    front: list[dict[str, Any]]
    importance: dict[str, dict[str, float]]
    verdicts: list[Verdict]
    trials: list[Trial]


def tune(
    path: Path, out: Path | None, workers: int, progress: Report, say: Say, storage: str | None = None, make: str = MAKE
) -> Tuned:
    """Search, choose, and judge on the hold-out; called again, it goes on where it was.

    Raises:
        BadInput: when file, folder or storage cannot be used.
        LedgerFailed: when the disk is full.
        WorkersFail: when no worker can be started.
    """
    tuning = load_tuning(path)
    folder = out or Path(FOLDER) / tuning.file.name
    with only_parent(folder), closing(Bench(tuning, folder, workers, make)) as bench:
        optuna_study = _opened(tuning, storage or f"sqlite:///{folder.absolute() / STORE}")
        _search(tuning, bench, optuna_study, progress)
        front = _front(tuning, optuna_study)
        chosen = _chosen(front)
        say(f"{len(front)} settings are on the Pareto front; the winner is trial {chosen['trial']}")
        verdicts = list(_judged(tuning, bench, chosen["settings"]))
        importance, trials = _importance(tuning, optuna_study), _trials(optuna_study)
        tuned = Tuned(folder, chosen["settings"], front, importance, verdicts, trials)
        _write(tuning, tuned)
    return tuned


# ---- the search


def _opened(tuning: Tuning, storage: str) -> Any:
    """The Optuna study in its database, begun or gone on with.

    Raises:
        BadInput: when the database cannot be used, or holds another tuning.
    """
    import optuna
    from sqlalchemy.exc import SQLAlchemyError

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    now = json.loads(canonical(_identity(tuning)))
    try:
        # no heartbeat: whose trial is dead we know at once, because we hold the folder
        store = optuna.storages.RDBStorage(storage)
        directions: list[Literal["minimize", "maximize"]] = ["minimize"] * len(tuning.file.objectives)
        study = optuna.create_study(
            storage=store, study_name=tuning.file.name, directions=directions, load_if_exists=True
        )
        was = study.user_attrs.get("identity")
        if was is None:
            study.set_user_attr("identity", now)
        elif changed := list(differences(was, now)):
            raise BadInput([f"{storage}: was begun with another tuning: {line}" for line in changed[:5]])
        for trial in study.get_trials(deepcopy=False, states=(optuna.trial.TrialState.RUNNING,)):
            study.tell(trial.number, state=optuna.trial.TrialState.FAIL)  # its process is dead: we hold the folder
    except (SQLAlchemyError, optuna.exceptions.OptunaError, ImportError) as error:
        raise BadInput([f"{storage}: cannot be used: {str(error).splitlines()[0]}"]) from error
    return study


def _identity(tuning: Tuning) -> dict[str, Any]:
    scans = {name: study.base for name, study in _parts(tuning).items()}
    scans |= {f"{name} scenes": study.scenes for name, study in _parts(tuning).items() if study.scenes}
    file = tuning.file.model_dump(mode="json", exclude={"name", "why", "trials", "time_limit_s", "memory_limit_mb"})
    return {**scans, "file": file, "code": code_version()}


def _parts(tuning: Tuning) -> dict[str, Study]:
    parts = {"tuning": tuning.tuning, "hold_out": tuning.hold_out}
    return parts if tuning.stress is None else {**parts, "stress": tuning.stress}


def _search(tuning: Tuning, bench: Bench, study: Any, progress: Report) -> None:
    """Ask for a batch, make its scans, tell what came of it, until there are trials enough.

    The batch and its random numbers do not depend on the workers or on when the search was interrupted.
    """
    from optuna.trial import TrialState

    file, done = tuning.file, (TrialState.COMPLETE, TrialState.PRUNED)
    while (count := len(study.get_trials(deepcopy=False, states=done))) < file.trials:
        progress("tune", count, file.trials)
        study.sampler = _sampler(tuning, count)
        if count == 0 and (default := _default(tuning)) is not None:
            study.enqueue_trial(default)
        trials = [study.ask() for _ in range(min(file.batch, file.trials - count))]
        settings = [_asked(tuning, trial) for trial in trials]
        for trial, setting in zip(trials, settings, strict=True):
            trial.set_user_attr("settings", setting)
        for trial, means in zip(trials, _looked_at(tuning, bench, study, settings), strict=True):
            if means is None:
                study.tell(trial, state=TrialState.PRUNED)
            else:
                study.tell(trial, list(means))
    progress("tune", file.trials, file.trials)


def _looked_at(
    tuning: Tuning, bench: Bench, study: Any, settings: list[dict[str, Any]]
) -> list[tuple[float, ...] | None]:
    """Means on all scans; None for what the first scans show to be worse in everything than half of all so far."""
    first = max(round(tuning.file.first_look * tuning.tuning.planned), 1)
    early = bench.scores(tuning.tuning, settings, slice(0, first))
    known = [trial.values for trial in study.get_trials(deepcopy=False) if trial.values is not None]
    bar = np.median(np.array(known), axis=0) if len(known) >= tuning.file.batch else None
    kept = [i for i, scores in enumerate(early) if bar is None or not (np.array(scores.mean) > bar).all()]
    found: list[tuple[float, ...] | None] = [None] * len(settings)
    if first >= tuning.tuning.planned or not kept:
        for i in kept:
            found[i] = early[i].mean
        return found
    late = bench.scores(tuning.tuning, [settings[i] for i in kept], slice(first, None))
    for i, scores in zip(kept, late, strict=True):
        found[i] = tuple(float(mean) for mean in np.vstack([early[i].each, scores.each]).mean(axis=0))
    return found


def _sampler(tuning: Tuning, count: int) -> Any:
    """The sampler of one batch, seeded by the search's seed and by how far it is, so that a resumed search goes on."""
    import optuna

    seed = int.from_bytes(sha256(f"{tuning.file.seed} {count}".encode()).digest()[:4], "big")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        return {
            "tpe": lambda: optuna.samplers.TPESampler(seed=seed, multivariate=True, constant_liar=True),
            "nsga2": lambda: optuna.samplers.NSGAIISampler(seed=seed),
            "random": lambda: optuna.samplers.RandomSampler(seed=seed),
        }[tuning.file.sampler]()


def _asked(tuning: Tuning, trial: Any) -> dict[str, Any]:
    """The settings that a trial is about; a choice is known to Optuna by its place in the list."""
    found: dict[str, Any] = {}
    for path, factor in tuning.search.items():
        if not is_number_range(factor):
            options = choices(factor)
            found[path] = options[trial.suggest_categorical(path, list(range(len(options))))]
            continue
        ends, log = (factor.low, factor.high), factor.scale == "log"  # type: ignore[attr-defined]
        if factor.whole:  # type: ignore[attr-defined]
            found[path] = trial.suggest_int(path, int(ends[0]), int(ends[1]), log=log)
        else:
            found[path] = float(f"{trial.suggest_float(path, *ends, log=log):.{DIGITS}g}")
    return found


def _default(tuning: Tuning) -> dict[str, Any] | None:
    """The base's own settings as a trial; None when they lie outside of the search."""
    found: dict[str, Any] = {}
    for path, factor in tuning.search.items():
        value = setting_at(tuning.tuning.base, path)
        if is_number_range(factor):
            if not factor.low <= value <= factor.high:  # type: ignore[attr-defined]
                return None
            found[path] = value
        else:
            same = [i for i, option in enumerate(choices(factor)) if canonical(option) == canonical(value)]
            if not same:
                return None
            found[path] = same[0]
    return found


# ---- the end


def _front(tuning: Tuning, study: Any) -> list[dict[str, Any]]:
    """The trials that no other is better than in everything."""
    return [
        {
            "trial": trial.number,
            "settings": trial.user_attrs["settings"],
            "objectives": dict(zip(tuning.file.objectives, trial.values, strict=True)),
        }
        for trial in sorted(study.best_trials, key=lambda trial: trial.number)
    ]


def _trials(study: Any) -> list[Trial]:
    """All trials that were not given up early, in the order in which they were asked for."""
    done = sorted((trial for trial in study.get_trials(deepcopy=False) if trial.values), key=lambda t: t.number)
    return [Trial(trial.number, trial.user_attrs["settings"], tuple(trial.values)) for trial in done]


def _chosen(front: list[dict[str, Any]]) -> dict[str, Any]:
    """The one of the front nearest to the best of each objective, each measured by its spread over the front."""
    values = np.array([list(one["objectives"].values()) for one in front])
    spread = np.ptp(values, axis=0)
    far = np.divide(values - values.min(axis=0), spread, out=np.zeros_like(values), where=spread > 0)
    return front[int(np.argmin((far**2).sum(axis=1)))]


def _judged(tuning: Tuning, bench: Bench, winner: dict[str, Any]) -> Iterator[Verdict]:
    """Winner and default on the hold-out, under stress, and on a few of the hold-out's scans in pictures."""
    yield _verdict(tuning, "points", *bench.scores(tuning.hold_out, [{}, winner], slice(None)))
    if tuning.stress is not None:
        yield _verdict(tuning, "points, under stress", *bench.scores(tuning.stress, [{}, winner], slice(None)))
    confirm = tuning.confirm
    if confirm.scans and confirm.fidelity != POINTS["sensing.fidelity"]:
        study = _in_fidelity(tuning.hold_out, confirm.fidelity)
        yield _verdict(tuning, confirm.fidelity, *bench.scores(study, [{}, winner], slice(0, confirm.scans)))


def _in_fidelity(study: Study, fidelity: str) -> Study:
    def pictured(base: dict[str, Any]) -> dict[str, Any]:
        return {**base, "sensing": {**base["sensing"], "fidelity": fidelity}}

    scenes = {name: Scene(base=pictured(one["base"]), methods=one["methods"]) for name, one in study.scenes.items()}
    return replace(study, base=pictured(study.base), scenes=scenes)


def _verdict(tuning: Tuning, fidelity: str, default: Scores, winner: Scores) -> Verdict:
    names = tuning.file.objectives
    parts = (default.each, winner.each, winner.each - default.each)
    means = [{name: mean_of(part[:, k]) for k, name in enumerate(names)} for part in parts]
    said = []
    for name, mean in means[2].items():
        if mean.half is None:
            said.append(f"{name}: one scan cannot tell ({mean.mean:+.3g}, n = {mean.n})")
            continue
        word = "better" if mean.mean < 0 else "WORSE"
        word = word if abs(mean.mean) > mean.half else "no difference beyond the noise"
        said.append(f"{name}: {word} ({mean.mean:+.3g} ± {mean.half:.3g}, n = {mean.n})")
    return Verdict(fidelity, means[0], means[1], means[2], "; ".join(said))


def _importance(tuning: Tuning, study: Any) -> dict[str, dict[str, float]]:
    """How much each setting matters to each objective; empty when there are too few trials to tell."""
    import optuna

    found = {}
    for k, name in enumerate(tuning.file.objectives):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # it says how it is meant, on every call
                found[name] = optuna.importance.get_param_importances(
                    study,
                    evaluator=optuna.importance.PedAnovaImportanceEvaluator(),
                    target=partial(_value, k),
                )
        except (ValueError, RuntimeError):
            found[name] = {}
    return {
        name: {path: round(float(share), DIGITS) for path, share in shares.items()} for name, shares in found.items()
    }


def _value(k: int, trial: Any) -> float:
    return float(trial.values[k])


def _write(tuning: Tuning, tuned: Tuned) -> None:
    """Write the method that the robot loads, all figures, and the page."""
    from scenarios.study.tune_page import tuning_page

    study = tuning.tuning
    recipe = Recipe(study.base, tuple(tuning.search), study.methods, RECORD, "")
    name = next(iter(study.methods))
    scenario = recipe.scenario(values_of(tuning, tuned.settings), name, study.seeds[0])
    figures = {
        "settings": tuned.settings,
        "front": tuned.front,
        "importance": tuned.importance,
        "verdicts": [asdict(verdict) for verdict in tuned.verdicts],
    }
    texts = {
        METHOD_FILE: settings_yaml(scenario.method),
        RESULT_FILE: json.dumps(figures, indent=1, default=lambda mean: mean._asdict()) + "\n",
        PAGE_FILE: tuning_page(tuning, tuned),
    }
    for file, text in texts.items():
        with whole_file(tuned.folder / file) as work:
            work.write_text(text, encoding="utf-8")
