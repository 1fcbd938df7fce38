"""Prints every row of a rerun recording as a line of JSON; of bytes the first two, as numbers."""

import json
import sys

from rerun.experimental import RrdReader


def plain(value):
    if isinstance(value, (list, tuple)):
        values = list(value)
        is_file = len(values) > 100 and all(isinstance(one, int) for one in values)
        return [plain(one) for one in (values[:2] if is_file else values)]
    if isinstance(value, bytes):
        return list(value[:2])
    return value.total_seconds() if hasattr(value, "total_seconds") else value


for chunk in RrdReader(sys.argv[1]).stream():
    batch = chunk.to_record_batch()
    # Others tell of the moment of writing, to the nanosecond, which Python's times are not.
    names = [name for name in batch.schema.names if name == "time" or ":" in name]
    for row in batch.select(names).to_pylist():
        values = {name: plain(value) for name, value in row.items()}
        print(json.dumps({"entity": chunk.entity_path, **values}, default=str))
