"""A child process that does nothing for an hour: `python -m shared.sleeper FILE PARENT`; FILE gets its number."""

import os
import sys
import time
from pathlib import Path

from stickslip.geometry.user_files.child_process import end_with

if __name__ == "__main__":
    end_with(int(sys.argv[2]))
    Path(sys.argv[1]).write_text(str(os.getpid()))
    time.sleep(3600)
