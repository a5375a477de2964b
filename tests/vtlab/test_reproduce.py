"""Which runs are computed again; test_cli.py compares them with those that are stored."""

from attrs import evolve

from vtlab.reproduce import first_runs


def test_first_runs_are_whole_tasks_and_no_more_than_there_are(tiny):
    many = evolve(tiny, runs=20)
    assert [first_runs(many, runs).runs for runs in (3, 99)] == [3, 20]
    assert first_runs(evolve(many, runs_per_task=5), 6).runs == 10
