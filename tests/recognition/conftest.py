"""Lets the tests import the helper modules beside them, `synthetic` and `oracle`.

With ``--import-mode=importlib`` pytest leaves ``sys.path`` alone.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
