"""The file of a table that was measured, as `farsight_files::MeasuredTable` writes it: documents quote it between marks
(`farsight measure --docs`). Needs nothing but Python.
"""
import datetime
import json
import os
import pathlib
import platform


def machine():
    """This machine's CPU, as Linux calls it, and how many of its threads may be used."""
    try:
        lines = pathlib.Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{next(names, platform.machine())}, {threads} threads"


class MeasuredTable:
    """Cells of text, and what is needed to measure them anew."""

    def __init__(self, command, columns):
        today = datetime.datetime.now(datetime.timezone.utc).date().isoformat()
        self.command, self.machine, self.date = command, machine(), today
        self.columns, self.rows = list(columns), []

    def put(self, *row):
        """Adds a row, in place of one whose first cell is the same."""
        assert len(row) == len(self.columns), row
        place = next((i for i, other in enumerate(self.rows) if other[0] == row[0]), len(self.rows))
        self.rows[place : place + 1] = [list(row)]

    def write(self, path):
        """Writes it to `path`, whole or not at all, a row a line."""
        text = lambda value: json.dumps(value, ensure_ascii=False, separators=(",", ":"))
        head = [f'  "{name}": {text(getattr(self, name))}' for name in ("command", "machine", "date", "columns")]
        rows = ",\n".join(f"    {text(row)}" for row in self.rows)
        path = pathlib.Path(path)
        scratch = path.with_name(f".{path.name}.{os.getpid()}.partial")
        scratch.write_text("{\n" + ",\n".join(head) + f',\n  "rows": [\n{rows}\n  ]\n}}\n', encoding="utf-8")
        os.replace(scratch, path)

    @classmethod
    def opened(cls, path, command, columns):
        """The table at `path`, to put rows into, if this command on this machine wrote it; else one without rows. A table
        of other columns is somebody else's, and an error."""
        table = cls(command, columns)
        if pathlib.Path(path).exists():
            kept = json.loads(pathlib.Path(path).read_text(encoding="utf-8"))
            if kept["columns"] != table.columns:
                raise SystemExit(f"{path}: a table of other columns; expected {', '.join(table.columns)}")
            if all(kept[name] == getattr(table, name) for name in ("command", "machine")):
                table.rows = kept["rows"]
        return table
