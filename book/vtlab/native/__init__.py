"""Whole runs in C++, of the tasks that it knows: on this machine, and in a reader's page."""
