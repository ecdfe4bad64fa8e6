"""Reads a recording with Python's mcap, whole and cut, and says as JSON what is in it: read.py FILE [CUT ...]"""

import io
import json
import sys

from mcap.reader import NonSeekingReader, make_reader


def count(reader):
    seen = {}
    try:
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            of_topic = seen.setdefault(channel.topic, {"schema": schema.name, "count": 0, "bytes": 0})
            of_topic["count"] += 1
            of_topic["bytes"] += len(message.data)
    except Exception as error:  # the end of a file that was cut
        return {"topics": seen, "error": type(error).__name__}
    return {"topics": seen, "error": None}


with open(sys.argv[1], "rb") as file:
    content = file.read()
whole = make_reader(io.BytesIO(content))
summary = whole.get_summary()
told = {
    "whole": count(whole),
    "statistics": None
    if summary is None or summary.statistics is None
    else {"messages": summary.statistics.message_count, "chunks": len(summary.chunk_indexes)},
    "cuts": {},
}
for cut in sys.argv[2:]:
    told["cuts"][cut] = count(NonSeekingReader(io.BytesIO(content[: int(cut)])))
json.dump(told, sys.stdout)
