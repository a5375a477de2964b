"""The laboratory: the thesis' tasks, and what runs, stores and verifies experiments."""
