"""Results: a file of rows that grows while a study runs, so that it can be stopped and resumed.

One json object a line: the fingerprint of the case, and the row. A line that a killed process left
unfinished is cut off; of several lines of the same case and solver the last one counts. Rows of
other states, other versions or another machine stay in the file, and are not used.
"""

from __future__ import annotations

import json
from pathlib import Path

from condyn_pin._core.files import parse_json
from condyn_pin.errors import InvalidArgument
from condyn_pin.study.row import Key, Row

_START = b'{"fingerprint": '


class Results:
    """Rows that were measured, in memory and in a file, which is read and appended to."""

    def __init__(self, path: str | Path | None) -> None:
        self._path = None if path is None else Path(path)
        self._rows: dict[tuple[str, Key], Row] = {}
        if self._path is not None:
            self._read(self._path)

    def find(self, fingerprint: str, key: Key) -> Row | None:
        """Return the row of a case and a solver, if it was measured."""
        return self._rows.get((fingerprint, key))

    def keep(self, fingerprint: str, row: Row) -> None:
        """Keep a row; it is in the file when this returns."""
        self._rows[fingerprint, row.key] = row
        if self._path is not None:
            line = json.dumps({"fingerprint": fingerprint, "row": row.as_dict()}, allow_nan=False)
            try:
                with self._path.open("a", encoding="utf-8") as file:
                    file.write(line + "\n")
            except OSError as error:
                raise InvalidArgument(
                    f"results = {str(self._path)!r}: {error.strerror}; what is in it stays, and "
                    "the next run goes on from there"
                ) from error

    def _read(self, path: Path) -> None:
        if path.exists() and not path.is_file():  # a pipe, or a device without an end
            raise InvalidArgument(f"results = {str(path)!r}: it is not a file")
        try:
            path.open("ab").close()  # what cannot be written to is refused now
            text = path.read_bytes()
        except OSError as error:
            raise InvalidArgument(f"results = {str(path)!r}: {error.strerror}") from error
        whole = text[: text.rfind(b"\n") + 1]
        for number, line in enumerate(whole.splitlines(), 1):
            try:
                entry = parse_json(line)
                row = Row.from_dict(entry["row"])
                self._rows[str(entry["fingerprint"]), row.key] = row
            except (ValueError, KeyError, TypeError) as error:
                raise _no_results(path, number, error) from error
        unfinished = text[len(whole) :]
        if unfinished and not unfinished.startswith(_START[: len(unfinished)]):
            raise _no_results(path, whole.count(b"\n") + 1, "it starts otherwise")
        if unfinished:
            with path.open("r+b") as file:
                file.truncate(len(whole))


def _no_results(path: Path, line: int, why: object) -> InvalidArgument:
    return InvalidArgument(
        f"results = {str(path)!r}, line {line}: not a row of a study ({why}); choose another file"
    )
