"""Trust with another posterior that learns, to ask what each of its settings is worth."""

from __future__ import annotations

from attrs import field, frozen

from vtlib.checks import kind
from vtlib.transfer import Settings
from vtlib.trust import Trust


@frozen
class VariedTrust(Trust):
    """Parameters of ``Trust`` whose posterior learns with ``learner``, in units of the sources.

    Raises ValueError for a learner that is none.
    """

    learner: Settings = field(kw_only=True, validator=kind(Settings))

    @property
    def in_units(self) -> Settings:
        """The parameters of the posterior that learns."""
        return self.learner
