"""Print the commands that README.md names for one purpose, so that CI runs what users are told.

A block of commands is marked in the README by a line `<!-- commands: PURPOSE -->` before it.
"""

import re
import sys
from pathlib import Path

purpose = sys.argv[1]
readme = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
block = re.search(rf"<!-- commands: {re.escape(purpose)} -->\n+```\w*\n(.*?)```", readme, re.DOTALL)
if block is None:
    sys.exit(f"README.md marks no commands for {purpose!r}")
print(block[1], end="")
