"""The parameter tables of appendix A, built from the configurations that the experiments run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from html import escape

from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.domains import Family, domain
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments.control import CAR, CARTPOLE
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.mazes import MAZE_TARGETS
from vtlib.experiments.protocol import html_table
from vtlib.experiments.rooms import ROOMS_EVALUATION
from vtlib.plots import power_of_ten
from vtlib.sources import Pool
from vtlib.transfer import CLIP, PRIOR_JITTER, Settings

Learner = MellowTDSettings | DDQNSettings
METHODS = {MellowTDSettings: "mellow TD", DDQNSettings: "DDQN"}

# The parameters in words, by group and by name in vtlib.
WORDS = {
    "runs": {
        "runs": "runs, each with its own target",
        "sources": "sources of a run",
        "iterations": "iterations (a step and a gradient each)",
        "every": "iterations between records",
        "d": "weights of the Q-function",
    },
    "transfer": {
        "components": "components C of the posterior",
        "lambda_": "weight λ of the divergence",
        "psi": "share ψ of the full gradient",
        "kappa": "sharpness κ of the mellowmax",
        "gamma": "discount γ",
        "batch": "mini-batch",
        "buffer": "replay buffer",
        "weights": "posterior samples per gradient and component",
        "alpha_mu": "step size of means (Adam)",
        "alpha_L": "step size of Cholesky factors (SGD)",
        "sigma_p2": "variance of the prior's components",
        "sigma_min": "least diagonal entry of a Cholesky factor",
        "jitter": "added to the variances of the prior",
        "clip": "bound on a gradient's entries",
        "init": "the posterior starts at the",
        "act": "weights are drawn anew each",
        "covariance": "covariance",
    },
    "learner": {
        "method": "method",
        "psi": "share ψ of the full gradient",
        "kappa": "sharpness κ of the mellowmax",
        "target_every": "iterations between copies of the target",
        "epsilon_steps": "iterations over which ε falls from 1",
        "epsilon_end": "what ε falls to",
        "gamma": "discount γ",
        "batch": "mini-batch",
        "buffer": "replay buffer",
        "alpha": "step size (Adam)",
    },
    "pool": {
        "count": "solved tasks in the pool",
        "iterations": "iterations before the first check",
        "check_every": "iterations between checks",
        "limit": "most iterations of an attempt",
        "attempts": "most attempts",
        "episodes": "episodes of a check",
        "required": "share required by a check",
        "common": "one start for all networks",
    },
}
UNNAMED = {"method", "jitter", "clip", "d"}  # not the name of any setting
ONLY = {"sigma_p2": "mixture", "jitter": "gaussian"}  # the family that has a parameter

# Where a value comes from, unless it is the environment's own section of the appendix.
PUBLISHED = "open: published code"
HERE = "open: chosen here"
AS_ROOMS = "open: as in the rooms"
COMMON = {
    "transfer.components": "chapter 6",
    "transfer.kappa": PUBLISHED,
    "transfer.jitter": PUBLISHED,
    "transfer.clip": PUBLISHED,
    "transfer.init": "Algorithm 1, line 2",
    "transfer.act": "Algorithm 1, line 7",
    "transfer.covariance": "5.2",
    "pool.common": PUBLISHED,
    "runs.every": HERE,
    "runs.iterations": HERE,
}


@dataclass(frozen=True)
class Environment:
    """What the book runs in one environment, and where its values come from.

    section is that of the appendix, results that of chapter 6. learners: how sources and the runs
    without transfer learn, and for how many iterations. origins: where values that the appendix
    does not give come from, by group and parameter, such as "transfer.buffer".
    """

    section: str
    results: str
    d: int
    transfer: Mapping[str, Settings]
    learners: Mapping[str, tuple[Learner, int]]
    pool: Pool
    runs: Mapping[str, int]
    origins: Mapping[str, str] = field(default_factory=dict)

    def origin(self, group: str, name: str) -> str:
        """Where a value comes from: a part of the thesis, or why it is what it is."""
        key = f"{group}.{name}"
        if key in self.origins or key in COMMON:
            return self.origins.get(key) or COMMON[key]
        if name == "gamma" or group == "runs" or key == "pool.count":
            return self.results
        return HERE if group == "pool" else self.section


def environment(
    experiment: Experiment, section: str, results: str, origins: Mapping[str, str]
) -> Environment:
    """An environment as its experiment runs it."""
    baseline = next(label for label in ("NT", "DDQN") if label in experiment.algorithms)
    learner = experiment.algorithms[baseline]
    assert isinstance(learner, MellowTDSettings | DDQNSettings)
    pool, q = experiment.pool, domain(experiment.family).q()
    # sources that may begin anew share out their exploration over an attempt
    solving = pool.limit if pool.attempts > 1 else pool.iterations
    return Environment(
        section,
        results,
        q.d,
        {label: experiment.transfer_settings(label) for label in ("GVT", "1-MGVT", "3-MGVT")},
        {
            "sources": (pool.settings, solving),
            baseline: (learner, experiment.iterations),
        },
        pool,
        {name: getattr(experiment, name) for name in ("runs", "sources", "iterations", "every")},
        origins,
    )


def _every(group: str, names: Sequence[str], origin: str) -> dict[str, str]:
    return {f"{group}.{name}": origin for name in names}


LEARNER_FIELDS = [name for name in WORDS["learner"] if name not in ("method", "kappa", "gamma")]


ROOMS = environment(
    ROOMS_EVALUATION,
    "A.1",
    "6.1",
    {
        "sources.kappa": PUBLISHED,
        **_every("NT", LEARNER_FIELDS, "open: as for the sources"),
        "NT.method": "5.1.4",
        "NT.kappa": PUBLISHED,
    },
)
CARTPOLES = environment(
    CARTPOLE,
    "A.2.1",
    "6.2.1",
    {
        "transfer.buffer": AS_ROOMS,
        "sources.method": "6.2.1",
        "sources.kappa": PUBLISHED,
        **_every("sources", ("psi", "epsilon_steps", "epsilon_end"), AS_ROOMS),
        "DDQN.method": "6.2",
        "DDQN.epsilon_end": AS_ROOMS,
    },
)
CARS = environment(
    CAR,
    "A.2.2",
    "6.2.2",
    {
        "transfer.buffer": AS_ROOMS,
        "sources.epsilon_end": AS_ROOMS,
        **_every("DDQN", LEARNER_FIELDS, "A.2.2, there for the sources"),
        "DDQN.method": "6.2",
        "DDQN.epsilon_end": AS_ROOMS,
    },
)
MAZES = environment(
    MAZE_TARGETS["north-east"],
    "A.2.3",
    "6.3",
    {
        "sources.epsilon_end": AS_ROOMS,
        **_every("DDQN", LEARNER_FIELDS, "A.2.3, there for the sources"),
        "DDQN.method": "6.3",
        "DDQN.epsilon_end": AS_ROOMS,
    },
)
# Appendix A by environment.
ENVIRONMENTS = {"rooms": ROOMS, "cartpole": CARTPOLES, "mountain car": CARS, "mazes": MAZES}


def tables(env: Environment) -> list[str]:
    """Every table of an environment, as HTML: runs, transfer, sources, no transfer."""
    found = [runs_table(env), transfer_table(env)]
    return found + [learner_table(env, label) for label in env.learners]


def runs_table(env: Environment) -> str:
    """How many runs, sources and iterations."""
    values = [{**env.runs, "d": env.d}]
    return _table(env, "The runs", ["value"], "runs", "runs", values)


def transfer_table(env: Environment) -> str:
    """The parameters of variational transfer, one column per algorithm."""
    values = []
    for settings in env.transfer.values():
        own = {**asdict(settings), "jitter": PRIOR_JITTER, "clip": CLIP}
        own["init"] = "prior" if settings.family == "gaussian" else settings.init
        values.append({k: v for k, v in own.items() if ONLY.get(k) in (None, settings.family)})
    heads = list(env.transfer)
    return _table(env, "Variational transfer", heads, "transfer", "transfer", values)


def learner_table(env: Environment, label: str) -> str:
    """How sources are solved, or how a task is learned without transfer."""
    learner, iterations = env.learners[label]
    own = {"method": METHODS[type(learner)], **asdict(learner)}
    share = learner.epsilon_steps / iterations
    own["epsilon_steps"] = f"{learner.epsilon_steps:,} of {iterations:,} ({share:g})"
    if label != "sources":
        return _table(env, f"Without transfer ({label})", ["value"], "learner", label, [own])
    pool = {**asdict(env.pool), "common": _yes(getattr(env.pool, "common", None))}
    more = _rows(env, "pool", "pool", [pool])
    return _table(env, "Source tasks", ["value"], "learner", label, [own], more)


def _yes(value: bool | None) -> str | None:
    return None if value is None else ("yes" if value else "no")


def _table(
    env: Environment,
    caption: str,
    heads: Sequence[str],
    words: str,
    group: str,
    values: Sequence[Mapping[str, object]],
    more: Sequence[str] = (),
) -> str:
    """One table; words names the group of WORDS, group that of the values' origins."""
    head = "".join(f"<th>{escape(x)}</th>" for x in ("parameter", *heads, "from"))
    body = "".join([*_rows(env, words, group, values), *more])
    return (
        '<div class="pst-scrollable-table-container"><table class="parameters">'
        f"<caption>{escape(caption)}</caption>"
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _rows(
    env: Environment, words: str, group: str, values: Sequence[Mapping[str, object]]
) -> list[str]:
    rows = []
    for name, text in WORDS[words].items():
        found = [one.get(name) for one in values]
        if any(value is not None for value in found):
            cells = [*map(shown, found), env.origin(group, name)]
            rest = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
            code = f" <code>{name}</code>" if name not in UNNAMED else ""
            rows.append(f"<tr><td>{escape(text)}{code}</td>{rest}</tr>")
    return rows


def shown(value: object) -> str:
    """A value as a reader writes it: thousands apart, small powers of ten raised."""
    if value is None:
        return "–"
    if isinstance(value, float) and 0 < value <= 1e-3 and f"{value:e}".startswith("1.000000"):
        return power_of_ten(value)
    return f"{value:,g}" if isinstance(value, float) else _whole(value)


def _whole(value: object) -> str:
    return f"{value:,}" if isinstance(value, int) else str(value)


def rooms_table(experiments: Sequence[Experiment]) -> str:
    """What rooms experiments differ in: tasks of sources and targets, and counts."""
    head = ["experiment", "sources", "targets", "runs", "sources of a run", "iterations"]
    rows = []
    for e in experiments:
        targets = e.runs // e.runs_per_task
        counts = sorted({e.sources_of(label) for label in e.algorithms})
        rows.append(
            [
                e.name,
                doors(e.pool.family),
                f"{targets}: {doors(e.family)}",
                shown(e.runs),
                f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}",
                shown(e.iterations),
            ]
        )
    return html_table(head, rows)


def doors(family: Family) -> str:
    """How the doors of a family of rooms are drawn, in words."""
    assert isinstance(family, RoomsFamily)
    law = "uniform" if family.normal is None else "normal({:g}, {:g})".format(*family.normal)
    if family.fixed_lower is None:
        return f"{family.rooms} rooms, doors {law}"
    fixed = f"{family.rooms} rooms, lower door at {family.fixed_lower:g}"
    return fixed if family.rooms == 2 else f"{fixed}, upper {law}"
