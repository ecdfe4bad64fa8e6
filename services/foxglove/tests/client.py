"""A client of Foxglove's protocol: prints what it received as JSON. Arguments: address, seconds at most."""

import asyncio
import json
import struct
import sys

import websockets

WANTED = {"/map", "/map/tiles", "/pose", "/tf", "/pose/estimate", "/path", "/health"}


async def main(address, seconds):
    seen, schemas, topics = {}, {}, {}
    async with websockets.connect(address, subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:
        deadline = asyncio.get_event_loop().time() + seconds
        while not WANTED <= seen.keys():
            left = deadline - asyncio.get_event_loop().time()
            if left <= 0:
                break
            try:
                message = await asyncio.wait_for(socket.recv(), left)
            except asyncio.TimeoutError:
                break
            if isinstance(message, str):
                told = json.loads(message)
                if told["op"] == "advertise":
                    for channel in told["channels"]:
                        topics[channel["id"]] = channel["topic"]
                        schemas[channel["topic"]] = channel["schemaName"]
                    ids = [{"id": channel["id"], "channelId": channel["id"]} for channel in told["channels"]]
                    await socket.send(json.dumps({"op": "subscribe", "subscriptions": ids}))
            elif message[0] == 1:
                (subscription,) = struct.unpack_from("<I", message, 1)
                payload = message[13:]
                topic = topics[subscription]
                seen[topic] = max(seen.get(topic, 0), len(payload))
                if topic == "/pose/estimate":
                    seen["estimate"] = json.loads(payload)
    print(json.dumps({"seen": seen, "schemas": schemas}))


asyncio.run(main(sys.argv[1], float(sys.argv[2])))
