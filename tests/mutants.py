"""Single-line faults, which the tests have to find, one at a time: python tests/mutants.py

On demand, for it takes a while. Names may be given to try only some files. A fault that
no test finds is a survivor.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
ELSEWHERE = {  # which tests are to find faults in a file, beside or instead of its mirror's
    "vtlib/td": "tests/test_td.py tests/test_algorithm1.py tests/test_transfer.py",
    "vtlib/priors": "tests/test_priors.py tests/test_algorithm1.py tests/test_transfer.py",
    "vtlib/posteriors/base": "tests/posteriors",
    "vtlib/posteriors/dense": "tests/posteriors",
    "vtlib/posteriors/diagonal": "tests/posteriors",
    "vtlib/posteriors/native": "tests/posteriors",
    "vtlib/posteriors/fused": "tests/posteriors",
    "vtlib/posteriors/blocked": "tests/posteriors",
    "vtlib/transfer": "tests/test_transfer.py tests/test_bad_input.py tests/test_algorithm1.py",
    "vtlib/replay": "tests/test_replay.py tests/test_transfer.py",
    "vtlib/envs/rooms/__init__": "tests/envs/rooms",
    "vtlib/envs/rooms/tasks": "tests/envs",
    "vtlib/envs/cartpole/tasks": "tests/envs",
    "vtlib/envs/mountain_car/tasks": "tests/envs",
    "vtlib/envs/maze/tasks": "tests/envs",
    "vtlib/envs/maze/geometry": "tests/envs",
}
FAULTS: dict[str, list[tuple[str, str]]] = {
    "vtlib/td": [
        (".mean(dim, keepdim=True).log_()", ".sum(dim, keepdim=True).log_()"),
        ("mellowmax(q_next, kappa, -2) * ~terminated", "mellowmax(q_next, kappa, -2)"),
        (".mul_(2 / batch)", ".mul_(1 / batch)"),
        (".mul_(psi / q.shape[-2])", ".mul_(psi)"),
        ("flow = (scaled_error * alive)", "flow = (scaled_error * gamma)"),
        ("alive = gamma * ~terminated", "alive = gamma"),
        ("-scaled_error.unsqueeze(-2))", "scaled_error.unsqueeze(-2))"),
        ("alpha=1 / kappa", "alpha=kappa"),
    ],
    "vtlib/priors": [
        ("/ freedom**0.5", "/ sources.shape[-2] ** 0.5"),
        ("if freedom < 1", "if freedom < 0"),
        ("add_(added)", "add_(2 * added)"),
        ("(singular**2 / (singular**2 + own)).sqrt()", "(singular**2 / (singular**2 + own))"),
        ("return Start(self.mu.clone(),", "return Start(self.mu,"),
        ("torch.arange(components) % count", "torch.zeros(components).long()"),
        ("toward / (self._variance * mu.shape[1])", "toward / self._variance"),
        ("return log_volumes + 0.5 *", "return log_volumes + 0.4 *"),
        ("else MAX_UPDATES if updates is None", "else 1 if updates is None"),
        ("log_phi - pairwise, -1)", "log_phi - pairwise, -2)"),
        ("- math.log(sources)\n", "- math.log(components)\n"),
        (".squeeze(-2) / variance", ".squeeze(-2)"),
    ],
    "vtlib/posteriors/base": [
        ("self._z[:, -used:]", "self._z[:, :used]"),
        ("samples += self.mu.unsqueeze(2)", "samples += 0 * self.mu.unsqueeze(2)"),
        ("math.inf if bound is None", "50 if bound is None"),
        ("(descent.clip, descent.kl_clip)", "(descent.kl_clip, descent.clip)"),
    ],
    "vtlib/posteriors/dense": [
        (".sub_(1 / diagonal)", ".sub_(1 / diagonal**2)"),
        ("pull.clamp_(-self._kl_clip, self._kl_clip)", "pull.clamp_(-self._kl_clip)"),
        ("        pull.clamp_(", "        pull.diagonal(dim1=1, dim2=2).clamp_("),
        ("beta=kl_weight", "beta=2 * kl_weight"),
        (
            "gradient.clamp_(-self._clip, self._clip)",
            "gradient.clamp_(-self._clip, 2 * self._clip)",
        ),
        (".tril_(), alpha", ", alpha"),
        (
            "        diagonal.clamp_(min=self._sigma_min)\n\n\ndef",
            "        diagonal.abs_()\n\n\ndef",
        ),
        ("* start.variance**0.5", "* start.variance"),
    ],
    "vtlib/posteriors/diagonal": [
        ("(gradients * z).sum(1)", "(gradients * z).mean(1)"),
        ("self._pull * self._sigma - 1", "self._pull * self._sigma**2 - 1"),
        ("double().rsqrt()", "double().sqrt()"),
        (".clamp_(-self._kl_clip, self._kl_clip)", ".clamp_(-self._kl_clip, 2 * self._kl_clip)"),
    ],
    "vtlib/posteriors/native": [
        ("min(self._clip, LARGEST)", "2 * min(self._clip, LARGEST / 2)"),
        ('self._kl == "diagonal"', "False"),
        ("min(self._kl_clip, LARGEST)", "min(self._clip, LARGEST)"),
        ("run * components", "run"),
        ("copy = memory.clone()", "copy = memory"),
    ],
    "vtlib/posteriors/fused": [
        ("        self._waiting = None\n        return out", "        return out"),
    ],
    "vtlib/posteriors/blocked": [
        ("self._precision.diagonal(d)", "torch.ones(d)"),
        ("if self._t == 0:", "if self._t < 2:"),
    ],
    "vtlib/qfunctions": [
        ("self._rate = 0.5 / variance", "self._rate = 1 / variance"),
        ("axes.div_(axes.sum(-2, keepdim=True))", "axes.div_(1.0)"),
        (".mul_(into.sign())", ".mul_(into)"),
        ("passed[-1].relu_()", "passed[-1].abs_()"),
        ("delta.sum(-1), *parts]", "delta.mean(-1), *parts]"),
        ("(axes[:, 0].unsqueeze(2) * axes[:, 1]", "(axes[:, 1].unsqueeze(2) * axes[:, 0]"),
    ],
    "vtlib/transfer": [
        ("s.lambda_ / self._steps", "s.lambda_ / (self._steps + 1)"),
        ("kl_weight / components", "kl_weight"),
        ("self._samples[:, :, 1:]", "self._samples[:, :, :-1]"),
        ("div_(components * s.n_samples)", "div_(s.n_samples)"),
        ("if self._steps > s.patience", "if self._steps >= s.patience"),
        ("step.clamp_(-s.clip, s.clip)", "step.clamp_(-s.clip, 2 * s.clip)"),
        ("draws = self._samples[:, :, 0]", "draws = self._samples[:, :, 1]"),
        ('if self._settings.act == "step"', 'if self._settings.act != "step"'),
        ("between(0, HUGE)", "between(-1, HUGE)"),
    ],
    "vtlib/recommended": [
        ("sources / self._unit,", "sources,"),
        ("self._unit / self._eta", "self._unit * self._eta"),
        ("torch.maximum(self._eta", "torch.minimum(self._eta"),
        ("self._updates - 1", "0 * self._updates"),
        ("patience=FIRST", "patience=0"),
        ("super()._thompson() * self._unit", "super()._thompson()"),
        ("alpha_L=SHARE *", "alpha_L=8 *"),
    ],
    "vtlib/baselines": [
        ("error.clamp_(-1, 1)", "error.clamp_(-2, 2)"),
        ("% self._settings.target_every == 0", "% self._settings.target_every == 1"),
        ("best = q.q(self.mu, following)", "best = q.q(self._target, following)"),
        ("explore < epsilon", "explore > epsilon"),
        ("(s.epsilon_end - s.epsilon_start)", "s.epsilon_end"),
        ("epsilon = s.epsilon_start + progress", "epsilon = 1 + progress"),
        ("sources[:, 0] if", "sources[:, -1] if"),
        ("sources.mean(1)", "sources.sum(1)"),
    ],
    "vtlib/training": [
        ("if t % every == 0:", "if t % every == 1:"),
        ("if t in FINGERPRINTS", "if t < 50"),
    ],
    "vtlib/evaluation": [
        ("alive *= ~terminated", "alive *= 1"),
        ("discount *= tasks.gamma", "discount *= 1"),
        ("else values.mean(1)", "else values[:, 0]"),
        ("values.amax(1) if", "values.mean(1) if"),
        ("mu.split(1, 1)", "mu[:, :1].split(1, 1)"),
    ],
    "vtlib/replay": [
        ("at = self._added % self._capacity", "at = self._added % (self._capacity + 1)"),
        ("reward, rows[..., o : 2 * o]", "reward, rows[..., :o]"),
    ],
    "book/vtbook/zero_shot": [
        ('episodes, "max")', 'episodes, "mean")'),
        ("weights[chosen_sources(experiment, runs)]", "weights[: experiment.sources][None]"),
    ],
    "book/vtbook/claims": [
        ("number.low >= self.low and number.high <= self.high", "number.low >= self.low"),
        ("(above and self.stronger ==", "(below and self.stronger =="),
        ("else UNDECIDED", "else NOT"),
        ("mean()) - self.floor", "mean())"),
        ("slice(None, t)", "slice(t, None)"),
        (">= OPTIMAL * own", ">= OPTIMAL * own.mean()"),
        (
            "early = np.abs(np.diff(curve)), iterations[1:]",
            "early = np.diff(curve), iterations[1:]",
        ),
        ("np.hypot(a.high - a.centre, b.high - b.centre)", "a.high - a.centre + b.high - b.centre"),
        ("(band.low <= theirs.high[at]) &", "(band.low <= theirs.high[at]) |"),
    ],
    "book/vtbook/costs": [
        ("floor + SOLVED * (runs.optimum - floor)", "SOLVED * runs.optimum"),
        ("np.where(reached.any(1), at, np.nan)", "at"),
        ("mean_interval(unknown - known)", "mean_interval(known - unknown)"),
        ("used * float", "float"),
    ],
    "vtlib/stats": [
        ("ppf(0.975,", "ppf(0.95,"),
        ("len(values) - 1)", "len(values))"),
        (", append=np.inf) > 0", ", append=np.inf) >= 0"),
    ],
    "book/vtbook/comparisons": [
        ("stats.sem(a - ratio * b)", "stats.sem(a - b)"),
        ("abs(b.mean())", "b.mean()"),
        ("ratios = a[chosen]", "ratios = a[chosen[::-1]]"),
        ("[below > 0] / below[below > 0]", "[below >= 0] / below"),
    ],
    "book/vtbook/likelihood": [
        ("likelihoods(experiment) - 1e-6", "likelihoods(experiment) + 1e-6"),
        ("row[x] / best", "row[x]"),
        ("((doors - mean) / deviation) ** 2", "(doors - mean) ** 2 / deviation"),
    ],
    "book/vtbook/published": [
        ("i = places[-1]", "i = places[0]"),
        (
            "self.iterations <= t\n        return Interval(*(",
            "self.iterations < t\n        return Interval(*(",
        ),
    ],
    "vtlib/experiments/run": [
        ('"each" if experiment.each else "mean"', '"mean"'),
    ],
    "vtlib/experiments/sources": [
        ("            passed &= pool.family.solved", "            pool.family.solved"),
        ("torch.where(passed, again.mean(1), earned)", "earned"),
        (
            'Rng(f"{pool.stream} fresh", sources)',
            'Rng(f"{pool.stream} fresh", range(len(sources)))',
        ),
    ],
    "vtlib/envs/episodes": [
        ("self._discount.mul_(self._gamma)", "self._discount.mul_(1.0)"),
        (">= tasks.horizon", "> tasks.horizon"),
        ("clamp(1, self._finished.shape[1])", "clamp(1)"),
    ],
    "vtlib/envs/rooms/__init__": [
        ("% self.ladder]", "% (self.ladder + 1)]"),
        ("return super().draw_tasks(stream, sources)", "return self.draw_tasks(stream, sources)"),
        ("Rooms.from_doors(doors, stops=self.stops)", "Rooms.from_doors(doors)"),
    ],
    "vtlib/envs/rooms/tasks": [
        ("> DOOR_WIDTH / 2", "> DOOR_WIDTH"),
        ("<= GOAL_RADIUS**2", "<= 2 * GOAL_RADIUS**2"),
        (".clamp(0.0, SIDE)", ".clamp(0.0, SIDE + 1)"),
        ("(aimed != proposed).any(1", "(aimed != proposed).all(1"),
        ("        if self.stops:", "        if not self.stops:"),
    ],
    "vtlib/envs/cartpole/tasks": [
        ("4 / 3 - self.pole_mass", "3 / 4 - self.pole_mass"),
        ("> POSITION_LIMIT)", "> ANGLE_LIMIT)"),
    ],
    "vtlib/envs/mountain_car/tasks": [
        ("(action - 1) * self.speed", "action * self.speed"),
        ("velocity < 0)", "velocity > 0)"),
        ("torch.where(terminated, self.last_reward, -1.0)", "terminated.float() - 1"),
    ],
    "vtlib/envs/maze/tasks": [
        ("* directions(pose[2])", "* directions(-pose[2])"),
        ("(share * count)", "(share * 100)"),
    ],
    "vtlib/envs/maze/geometry": [
        ("np.minimum(goal, own) < wall", "np.minimum(goal, own) > wall"),
        ("line = cell + 0.5 + (0.5 - CLEARANCE) * sign", "line = cell + 0.5 + 0.5 * sign"),
    ],
}


class Outcome(NamedTuple):
    """What became of one fault: killed, survived or not applied."""

    file: str
    fault: str
    fate: str


def tests_of(file: str) -> list[str]:
    """The tests that are to find faults in a file: by default those of the file beside it."""
    mirror = Path("tests", *Path(file).parts[1:])
    return ELSEWHERE.get(file, str(mirror.with_name(f"test_{mirror.name}.py"))).split()


def attempt(file: str, old: str, new: str) -> Outcome:
    """Plant one fault in a copy of both packages and run the tests of its file."""
    text = (ROOT / f"{file}.py").read_text()
    if text.count(old) != 1:
        return Outcome(file, old, f"NOT APPLIED: found {text.count(old)} times")
    with tempfile.TemporaryDirectory() as folder:
        for part in ("vtlib", "tests", "book/vtbook"):
            shutil.copytree(ROOT / part, Path(folder) / part)
        for part in {*(ROOT / "book").iterdir()} - {ROOT / "book" / "vtbook"}:
            (Path(folder) / "book" / part.name).symlink_to(part)
        shutil.copy(ROOT / "pyproject.toml", folder)
        (Path(folder) / f"{file}.py").write_text(text.replace(old, new))
        command = [sys.executable, "-m", "pytest", "-x", "-q", *tests_of(file)]
        packages = {"PYTHONPATH": f"{folder}{os.pathsep}{folder}/book", "OMP_NUM_THREADS": "1"}
        done = subprocess.run(
            command, cwd=folder, env={**os.environ, **packages}, capture_output=True, check=False
        )
    fate = {0: "SURVIVED", 1: "killed", 2: "killed"}.get(done.returncode, "no tests ran")
    return Outcome(file, f"{old!r} -> {new!r}", fate)


def untouched(file: str) -> Outcome:
    """What its tests make of a file without a fault: its first line stands for itself."""
    first = (ROOT / f"{file}.py").read_text().partition("\n")[0]
    return attempt(file, first, first)


def main(only: list[str]) -> int:
    """Try all faults, two at a time; fail when fewer than 95 % are killed or one does not apply."""
    faults = [(f, *pair) for f, pairs in FAULTS.items() if not only or f in only for pair in pairs]
    outcomes = []
    with ThreadPoolExecutor(2) as executor:
        files = dict.fromkeys(file for file, *_ in faults)
        for outcome in executor.map(untouched, files):
            if outcome.fate != "SURVIVED":
                print(f"{outcome.file}: its tests fail without a fault ({outcome.fate})")
                return 2
        for outcome in executor.map(lambda fault: attempt(*fault), faults):
            print(f"{outcome.fate:10} {outcome.file}: {outcome.fault}", flush=True)
            outcomes.append(outcome)
    missed = [outcome for outcome in outcomes if outcome.fate != "killed"]
    print(*missed, f"{len(missed)} of {len(outcomes)} faults are not found", sep="\n")
    applied = all(outcome.fate == "SURVIVED" for outcome in missed)
    return 0 if applied and len(missed) <= 0.05 * len(outcomes) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
