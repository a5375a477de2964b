"""Command line: python -m vtlab run | verify | reproduce, and what packages add."""

import sys

from vtlab.interrupts import end_at_once

if __name__ == "__main__":
    end_at_once()  # before the imports, which take seconds
    from vtlab.cli import main

    sys.exit(main())
