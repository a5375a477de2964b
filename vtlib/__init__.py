"""Variational transfer of value functions between reinforcement learning tasks."""

__version__ = "0.1.0"
