"""Writes a ROS 1 bag again in every way that others would: packed bags, MCAP with messages of ROS 1 and 2, folders of rosbag2."""

import subprocess
import sys
from pathlib import Path

from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Reader, Writer

source, out = Path(sys.argv[1]), Path(sys.argv[2])

for packing in (Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4):
    with Reader(source) as reader:
        writer = Writer(out / f"{packing.name.lower()}.bag")
        writer.set_compression(packing)
        writer.open()
        to = {}
        for c in reader.connections:
            to[c.id] = writer.add_connection(
                c.topic, c.msgtype, msgdef=c.msgdef.data, md5sum=c.digest, callerid=c.ext.callerid, latching=c.ext.latching
            )
        for c, time, raw in reader.messages():
            writer.write(to[c.id], time, raw)
        writer.close()

for packing in CompressionType:
    with Reader(source) as reader, open(out / f"ros1_{packing.name.lower()}.mcap", "wb") as file:
        writer = McapWriter(file, compression=packing)
        writer.start(profile="ros1")
        to = {}
        for c in reader.connections:
            schema = writer.register_schema(c.msgtype.replace("/msg/", "/"), "ros1msg", c.msgdef.data.encode())
            to[c.id] = writer.register_channel(c.topic, "ros1", schema)
        for c, time, raw in reader.messages():
            writer.add_message(to[c.id], time, raw, time)
        writer.finish()

convert = [str(Path(sys.executable).with_name("rosbags-convert")), "--src", str(source), "--dst"]
for name, options in (
    ("ros2_mcap", ["--dst-storage", "mcap"]),
    ("ros2_sqlite3", ["--dst-storage", "sqlite3"]),
    ("ros2_sqlite3_files", ["--dst-storage", "sqlite3", "--compress", "zstd", "--compress-mode", "file"]),
    ("ros2_sqlite3_messages", ["--dst-storage", "sqlite3", "--compress", "zstd", "--compress-mode", "message"]),
):
    subprocess.run([*convert, str(out / name), *options], check=True)
