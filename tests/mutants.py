"""Single-line faults, one at a time, for the tests to find: python tests/mutants.py [FILE...]"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# which tests are to find faults in a file or a folder, beside or instead of the file's mirror
ELSEWHERE = {
    "vtlib/td": "tests/test_td.py tests/test_algorithm1.py tests/test_transfer.py",
    "vtlib/priors": "tests/test_priors.py tests/test_algorithm1.py tests/test_transfer.py",
    "vtlib/posteriors/": "tests/posteriors",
    "vtlib/transfer": "tests/test_transfer.py tests/test_bad_input.py tests/test_algorithm1.py",
    "book/vtlab/envs/": "tests/vtlab/envs",
}
# those that any test would find, such as another sign, are left out
FAULTS: dict[str, list[tuple[str, str]]] = {
    "vtlib/td": [
        (".mean(dim, keepdim=True).log_()", ".sum(dim, keepdim=True).log_()"),
        ("mellowmax(q_next, kappa, -2) * ~terminated", "mellowmax(q_next, kappa, -2)"),
        (".mul_(psi / q.shape[-2])", ".mul_(psi)"),
        ("flow = (scaled_error * alive)", "flow = (scaled_error * gamma)"),
        ("alive = gamma * ~terminated", "alive = gamma"),
    ],
    "vtlib/priors": [
        ("/ freedom**0.5", "/ sources.shape[-2] ** 0.5"),
        (
            "(singular**2 / (singular**2 + variance)).sqrt()",
            "(singular**2 / (singular**2 + variance))",
        ),
        ("return Start(self.mu.clone(),", "return Start(self.mu,"),
        ("torch.arange(components) % count", "torch.zeros(components).long()"),
        ("toward / (self._variance * mu.shape[1])", "toward / self._variance"),
        ("- math.log(sources)\n", "- math.log(components)\n"),
    ],
    "vtlib/posteriors/base": [
        ("self._z[:, -count:]", "self._z[:, :count]"),
        ("(descent.clip, descent.kl_clip)", "(descent.kl_clip, descent.clip)"),
    ],
    "vtlib/posteriors/dense": [
        ("pull.clamp_(-self._kl_clip, self._kl_clip)", "pull.clamp_(-self._kl_clip)"),
        ("        pull.clamp_(", "        pull.diagonal(dim1=1, dim2=2).clamp_("),
        (".tril_(), alpha", ", alpha"),
        (" diagonal.clamp_(min=self._sigma_min)", " diagonal.abs_()"),
    ],
    "vtlib/posteriors/native": [
        ("min(self._clip, LARGEST)", "2 * min(self._clip, LARGEST / 2)"),
        ("run * components", "run"),
        ("copy = memory.clone()", "copy = memory"),
    ],
    "vtlib/qfunctions": [
        (".mul_(into.sign())", ".mul_(into)"),
        ("delta.sum(-1), *parts]", "delta.mean(-1), *parts]"),
        ("(axes[:, 0].unsqueeze(2) * axes[:, 1]", "(axes[:, 1].unsqueeze(2) * axes[:, 0]"),
    ],
    "vtlib/transfer": [
        ("s.lambda_ / self._steps", "s.lambda_ / (self._steps + 1)"),
        ("kl_weight / components", "kl_weight"),
        ("self._samples[:, :, 1:]", "self._samples[:, :, :-1]"),
        ("_steps > self._settings.patience", "_steps >= self._settings.patience"),
        ("draws = self._samples[:, :, 0]", "draws = self._samples[:, :, 1]"),
    ],
    "book/vtlab/envs/maze/tasks": [
        ("directions(pose[2]) + jolt[:2]", "directions(pose[2])"),
    ],
}


def tests_of(file: str) -> list[str]:
    """The tests that are to find faults in a file: by default those of the file beside it."""
    mirror = Path("tests", *Path(file).parts[1:])
    named = (tests for start, tests in ELSEWHERE.items() if file.startswith(start))
    return next(named, str(mirror.with_name(f"test_{mirror.name}.py"))).split()


def attempt(fault: tuple[str, str, str]) -> str:
    """Plant one fault in a copy of the packages; what the tests of its file make of it."""
    file, old, new = fault
    text = (ROOT / f"{file}.py").read_text()
    if text.count(old) != 1:
        return f"NOT APPLIED: found {text.count(old)} times"
    with tempfile.TemporaryDirectory() as folder:
        packages = {ROOT / "book" / name for name in ("vtlab", "vtbook")}
        for part in (ROOT / "vtlib", ROOT / "tests", *packages):
            shutil.copytree(part, Path(folder) / part.relative_to(ROOT))
        for part in {*(ROOT / "book").iterdir()} - packages:
            (Path(folder) / "book" / part.name).symlink_to(part)
        shutil.copy(ROOT / "pyproject.toml", folder)
        (Path(folder) / f"{file}.py").write_text(text.replace(old, new))
        command = [sys.executable, "-m", "pytest", "-x", "-q", *tests_of(file)]
        found = {"PYTHONPATH": f"{folder}{os.pathsep}{folder}/book", "OMP_NUM_THREADS": "1"}
        done = subprocess.run(
            command, cwd=folder, env={**os.environ, **found}, capture_output=True, check=False
        )
    return {0: "SURVIVED", 1: "killed", 2: "killed"}.get(done.returncode, "no tests ran")


def main(only: list[str]) -> int:
    """Try all faults, two at a time; fail when fewer than 95 % are killed or one does not apply."""
    files = {file: pairs for file, pairs in FAULTS.items() if not only or file in only}
    # a first line that stands for itself is no fault
    alike = {(*tests_of(file),): file for file in files}.values()
    firsts = [(file, *[next((ROOT / f"{file}.py").open())] * 2) for file in alike]
    faults = [(file, *pair) for file, pairs in files.items() for pair in pairs]
    fates = []
    with ThreadPoolExecutor(2) as executor:
        for fault, fate in zip(firsts, executor.map(attempt, firsts), strict=True):
            if fate != "SURVIVED":
                print(f"{fault[0]}: its tests fail without a fault ({fate})")
                return 2
        for (file, old, new), fate in zip(faults, executor.map(attempt, faults), strict=True):
            print(f"{fate:10} {file}: {old!r} -> {new!r}", flush=True)
            fates.append(fate)
    missed = [fate for fate in fates if fate != "killed"]
    print(f"{len(missed)} of {len(fates)} faults are not found")
    return 0 if {*missed} <= {"SURVIVED"} and len(missed) <= 0.05 * len(fates) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
