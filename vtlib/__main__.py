"""Command line: python -m vtlib run | verify | reproduce, and what packages add."""

import sys

from vtlib.interrupts import end_at_once

if __name__ == "__main__":
    end_at_once()  # before the imports, which take seconds
    from vtlib.cli import main

    sys.exit(main())
