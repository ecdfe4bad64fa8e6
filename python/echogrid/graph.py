"""A process in a graph: its domain, ports, health, and who has taken in what."""

import fcntl
import os
import re
import select
import signal
import sys
import time
from pathlib import Path

import iceoryx2 as iox2

from . import layouts

try:
    import tomllib
except ModuleNotFoundError:  # before Python 3.11
    import tomli as tomllib

END = 1
STARTING, RUNNING, DRAINING, FINISHED, FAILED, GONE = 1, 2, 3, 4, 5, 6
HEARTBEAT_S = 0.25
# Readings that half of the room of range/scan is for, in bytes; see docs/topics.md.
_SCAN_BYTES = 2 << 20
_WINDOWS = {"odometry/raw": 1024, "odometry/estimate": 1024, "truth/pose": 1024, "localization/request": 16, "map/tiles": 64}


class GraphError(Exception):
    """The graph can't be entered, or what was asked for can't be."""


class Orphaned(BaseException):
    """The launcher is gone: nobody is to be waited for. Not an `Exception`, so that nobody takes it for an error of theirs."""


class Stopped(BaseException):
    """The launcher asks for the end of the streams. Caught by the `with` of a sensor."""


def text_of(array):
    """The text in an array of bytes, up to the first zero."""
    return bytes(array).split(b"\0", 1)[0].decode("utf-8", "replace")


def put_text(array, text):
    """Text into an array of bytes, cut at a character."""
    raw = text.encode()[: len(array)]
    while True:
        try:
            raw.decode()
            break
        except UnicodeDecodeError:
            raw = raw[:-1]
    array[:] = list(raw.ljust(len(array), b"\0"))


class Domain:
    """The place of a graph in shared memory; lived in for as long as this is kept."""

    def __init__(self, name):
        if not re.fullmatch(r"[a-z0-9-]{1,20}", name):
            raise GraphError(f"domain {name!r}: expected 1 to 20 of a-z, 0-9 and -")
        root = Path(f"/dev/shm/echogrid-{os.getuid()}")
        self.folder = root / name
        try:
            self._members = open(root / f"{name}.members", "rb")
            fcntl.flock(self._members, fcntl.LOCK_SH | fcntl.LOCK_NB)
            self.plan = tomllib.loads((self.folder / "plan.toml").read_text())
        except OSError as error:
            raise GraphError(f"domain {name!r}: no graph runs there ({error.strerror})") from error
        iox2.set_log_level(iox2.LogLevel.Error)
        config = iox2.config.setup_global_config_from_file(iox2.FilePath.new(str(self.folder / "config/iceoryx2.toml")))
        self.node = (
            iox2.NodeBuilder.new()
            .config(config)
            .signal_handling_mode(iox2.SignalHandlingMode.Disabled)
            .create(iox2.ServiceType.Ipc)
        )

    def _service(self, name):
        return self.node.service_builder(iox2.ServiceName.new(name))

    def topic(self, name, topic=None):
        """The publish-subscribe service of a topic; `topic` says what one is that the contract does not have."""
        topic = topic or layouts.TOPICS[name]
        schema = iox2.AttributeVerifier.new().require(
            iox2.AttributeKey.new("schema"), iox2.AttributeValue.new(topic.payload.type_name())
        )
        payload = iox2.Slice[topic.payload] if topic.is_slice else topic.payload
        return self._service(name).publish_subscribe(payload).user_header(layouts.Header).open_with_attributes(schema)

    def event(self, name):
        """The event service of the same name."""
        return self._service(name).event().open()


def running_domain():
    """The domain that the environment names, or the only one in which a graph runs."""
    named = os.environ.get("ECHOGRID_DOMAIN")
    if named:
        return named
    root = Path(f"/dev/shm/echogrid-{os.getuid()}")
    plans = [plan.parent.name for plan in root.glob("*/plan.toml")]
    if len(plans) != 1:
        raise GraphError(f"{len(plans)} graphs run ({', '.join(sorted(plans)) or 'none'}): name the domain of one")
    return plans[0]


class Output:
    """A topic that this process writes."""

    def __init__(self, domain, name, epoch, slice_len=1, topic=None):
        self.name, self.topic, self.epoch = name, topic or layouts.TOPICS[name], epoch
        builder = domain.topic(name, topic).publisher_builder()
        self._publisher = (builder.initial_max_slice_len(slice_len) if self.topic.is_slice else builder).create()
        self._notifier = domain.event(name).notifier_builder().create()
        self._life = time.time_ns() & 0xFFFFFFFF
        self.sequence = 0
        self.is_stream = self.topic.delivery in ("lossless", "relayed")

    def send(self, stamp_ns, payload, flags=0):
        """A structure, or a list of them; takes the number after `sequence`."""
        self.sequence += 1
        if self.topic.is_slice:
            sample = self._publisher.loan_slice_uninit(len(payload))
            view = sample.payload()
            for index, element in enumerate(payload):
                view[index] = element
        else:
            sample = self._publisher.loan_uninit()
        header = sample.user_header().contents
        header.sequence, header.epoch, header.stamp_ns = self.sequence, self.epoch, stamp_ns
        header.flags, header.robot, header.life = flags, 0, self._life
        (sample.assume_init() if self.topic.is_slice else sample.write_payload(payload)).send()

    def ring(self):
        """Wakes whoever reads."""
        self._notifier.notify()

    def greet(self):
        """Lets those who came late have the history."""
        self._publisher.update_connections()
        self.ring()


class Input:
    """A topic that this process reads."""

    def __init__(self, domain, name):
        self._listener = domain.event(name).listener_builder().create()
        self._subscriber = domain.topic(name).subscriber_builder().create()

    def wait(self, seconds):
        """Until something came, or so long."""
        self._listener.timed_wait(iox2.Duration.from_secs_f64(seconds))

    def __iter__(self):
        """Headers and payloads of all that has come; both are gone with the next."""
        self._listener.try_wait()
        while (sample := self._subscriber.receive()) is not None:
            yield sample.user_header().contents, sample.payload()


class Participant:
    """A process that the launcher knows: it says how it is, hears how others are, and knows when to leave."""

    def __init__(self, reads=()):
        name = os.environ.get("ECHOGRID_SERVICE", "")
        if not name or not os.environ.get("ECHOGRID_DOMAIN"):
            raise GraphError("not started by echogrid: name this program in a graph file, or by `echogrid up GRAPH --sensor PROGRAM`")
        # What ends a service is the launcher's word alone; anybody else's kills it, as ever.
        signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
        self.domain = Domain(os.environ["ECHOGRID_DOMAIN"])
        self.plan, self.name = self.domain.plan, name
        self.health = layouts.Health(pid=os.getpid(), state=STARTING)
        put_text(self.health.service, name)
        self._heard = Input(self.domain, "health")
        self._gone = set(filter(None, os.environ.get("ECHOGRID_GONE", "").split(",")))
        self._pids, self._acks, self._first_acks, self._next_beat = set(), {}, {}, 0.0
        self.inputs = {topic: Input(self.domain, topic) for topic in reads}
        self.outputs = {}
        self._health_out = Output(self.domain, "health", time.time_ns())
        self.is_stopped = False

    def open_outputs(self, names):
        """Opens the topics that this process writes."""
        for name in names:
            lossless = layouts.TOPICS[name].delivery == "lossless"
            epoch = self.plan["epoch"] if lossless else time.time_ns()
            self.outputs[name] = Output(self.domain, name, epoch, self.plan["max_readings"])

    def window(self, topic):
        """How far ahead of its slowest reader the writer of a topic may be, messages."""
        if topic == "range/scan":
            return min(max(_SCAN_BYTES // (16 * self.plan["max_readings"]), 64), 2048) // 2
        return _WINDOWS.get(topic, 1 << 62)

    def acknowledged(self, topic):
        """The last message that none of its readers needs again; none while one of them has not been heard of."""
        output = self.outputs[topic]
        lowest = 1 << 62
        for reader in self.plan.get("consumers", {}).get(topic, []):
            if reader in self._gone:
                continue
            heard = self._acks.get((reader, output.topic.code))
            if heard is None:
                return None
            epoch, sequence = heard
            lowest = min(lowest, sequence if epoch == output.epoch else 0)
        return lowest

    def may_end(self, topic):
        """Whether a topic may end here: no reader has more of it, of an earlier life of this program, and would not take the
        end for one. What readers had stored when they were heard of first tells how much that can be: a window beyond it."""
        output = self.outputs[topic]
        if output.topic.delivery != "lossless":
            return True
        if self.acknowledged(topic) is None:
            return False
        stored = [
            sequence if epoch == output.epoch else 0
            for (_, code), (epoch, sequence) in self._first_acks.items()
            if code == output.topic.code
        ]
        return not any(stored) or output.sequence >= max(max(stored), min(stored) + self.window(topic))

    def beat(self, now=False):
        """Says how this process is, if that is due."""
        if now or time.monotonic() >= self._next_beat:
            self._health_out.send(0, self.health)
            self._health_out.ring()
            self._next_beat = time.monotonic() + HEARTBEAT_S

    def attend(self, patience_s=0.0):
        """Hears what others say, beats, and looks whether it is time to leave; waits a little for any of it."""
        if patience_s > 0:
            self._heard.wait(min(patience_s, 0.05))
        for _, health in self._heard:
            self._hear(health.contents)
        self.beat()
        self._look_for_the_end()

    def _hear(self, health):
        name = text_of(health.service)
        if health.state == GONE:
            self._gone.add(name)
        # What one that is done took in may not be stored: that it is gone is for the launcher to say.
        elif health.state not in (STARTING, FINISHED):
            for ack in health.acks[: min(health.ack_count, len(health.acks))]:
                key, heard = (name, ack.topic), (ack.epoch, ack.sequence)
                self._first_acks.setdefault(key, heard)
                before = self._acks.get(key, (0, 0))
                self._acks[key] = max(before, heard) if before[0] == heard[0] else heard
        if health.pid not in self._pids:
            self._pids.add(health.pid)
            for output in self.outputs.values():
                output.greet()

    def _look_for_the_end(self):
        readable, _, _ = select.select([0], [], [], 0) if os.environ.get("ECHOGRID_LIFELINE") == "stdin" else ([], [], [])
        if readable and not os.read(0, 64):
            raise Orphaned("the launcher is gone")
        while (caught := signal.sigtimedwait(_ENDING, 0)) is not None:
            if caught.si_pid != os.getppid():
                signal.signal(caught.si_signo, signal.SIG_DFL)
                signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)
                os.kill(os.getpid(), caught.si_signo)
            if self.is_stopped:
                sys.exit(1)
            self.is_stopped = True

    def end(self):
        """Ends all streams, and waits until every reader is done with them."""
        self.health.state = DRAINING
        for output in self.outputs.values():
            if output.is_stream:
                output.send(self.health.stamp_ns, [] if output.topic.is_slice else output.topic.payload(), flags=END)
                output.ring()
        self.beat(now=True)
        streams = [name for name, output in self.outputs.items() if output.is_stream]
        while any((self.acknowledged(name) or 0) < self.outputs[name].sequence for name in streams):
            self.attend(patience_s=1.0)
        self.health.state = FINISHED
        self.beat(now=True)

    def fail(self, error):
        """Says why this process can't go on; the user reads that."""
        self.health.state = FAILED
        put_text(self.health.last_error, error)
        self.beat(now=True)


_ENDING = {signal.SIGTERM, signal.SIGINT, signal.SIGHUP}
