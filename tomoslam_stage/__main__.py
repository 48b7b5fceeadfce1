"""``python -m tomoslam_stage``."""

from __future__ import annotations

import sys

from tomoslam_stage.cli import main

if __name__ == "__main__":
    sys.exit(main())
