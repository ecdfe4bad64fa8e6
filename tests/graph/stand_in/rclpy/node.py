"""Nodes of the stand-in."""

from types import SimpleNamespace as Some


class Publisher:
    def __init__(self, topic):
        self.topic = topic

    def publish(self, message):
        info, data = message.info, message.data
        known = sum(cell >= 0 for cell in data)
        print(f"{self.topic} {message.header.frame_id} {info.width} x {info.height} of {info.resolution}: {known} known", flush=True)


class Node:
    def __init__(self, name):
        self.name, self.handlers = name, {}

    def declare_parameter(self, name, default):
        return Some(value=default)

    def create_subscription(self, kind, topic, handler, qos):
        self.handlers[topic] = handler

    def create_publisher(self, kind, topic, qos):
        return Publisher(topic)

    def get_clock(self):
        return Some(now=lambda: Some(to_msg=lambda: 0))
