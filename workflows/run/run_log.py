"""run.log: what the program's own loggers say while a run works; a resumed run goes on in the same file."""

from __future__ import annotations

import logging
from contextlib import suppress
from pathlib import Path

LOGGERS = ("geometry", "solvers", "workflows")


class RunLog(logging.FileHandler):
    """Context in which lines go to the file. A full disk is told by the step that cannot be written, not here."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, encoding="utf-8")
        self._former: dict[str, int] = {}  # levels of the loggers
        self.setFormatter(logging.Formatter("%(asctime)s %(name)s %(levelname)s %(message)s"))

    def __enter__(self) -> RunLog:
        for name in LOGGERS:
            logger = logging.getLogger(name)
            self._former[name] = logger.level
            logger.addHandler(self)
            logger.setLevel(logging.INFO)
        return self

    def __exit__(self, *error: object) -> None:
        for name in LOGGERS:
            logging.getLogger(name).removeHandler(self)
            logging.getLogger(name).setLevel(self._former[name])
        with suppress(OSError):
            self.close()

    def handleError(self, record: logging.LogRecord) -> None:
        """Say nothing."""
