"""Shared parts of the peers with Eclipse Cyclone DDS. They import neither the project nor ROS.

Names follow ROS 2's mapping to DDS: the topic ``/tf`` is ``rt/tf``, a service is a pair of topics,
``rq/NAMERequest`` and ``rr/NAMEReply``. The metadata of a sample identifies the request of a reply.
These readers do not see the metadata, so a service has one pending request at a time.
"""

import os

from cyclonedds.core import DDSStatus, Policy, Qos, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

RELIABLE = Policy.Reliability.Reliable(duration(seconds=1))
QOS = Qos(RELIABLE, Policy.Durability.Volatile, Policy.History.KeepLast(1000))
LATCHED = Qos(RELIABLE, Policy.Durability.TransientLocal, Policy.History.KeepLast(1000))
MAX_TRIES = 90
DEADLINE_S = 90


def participant():
    return DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))


def reader(owner, name, kind, qos=QOS):
    return DataReader(owner, Topic(owner, name, kind, qos=qos), qos=qos)


def writer(owner, name, kind, qos=QOS):
    return DataWriter(owner, Topic(owner, name, kind, qos=qos), qos=qos)


def wait_for_publisher(owner, of):
    """Wait until the reader ``of`` has discovered a writer.

    A volatile reader drops samples sent before, even if the writer has discovered the reader.
    """
    of.set_status_mask(DDSStatus.SubscriptionMatched)
    waiting = WaitSet(owner)
    waiting.attach(of)
    if waiting.wait(timeout=duration(seconds=DEADLINE_S)) == 0:
        raise TimeoutError(f"no publisher of {of.topic.name} found")
    waiting.detach(of)


def next_sample(of, accept=lambda sample: True):
    """Return the next sample that ``accept`` accepts; raises `TimeoutError`."""
    for sample in of.take_iter(timeout=duration(seconds=DEADLINE_S)):
        if accept(sample):
            return sample
    raise TimeoutError(f"no expected sample on {of.topic.name}")


class Service:
    """Requests and replies of one service."""

    def __init__(self, owner, name, request_type, reply_type):
        self._reader = reader(owner, f"rr/{name}Reply", reply_type)
        self._writer = writer(owner, f"rq/{name}Request", request_type)

    def send(self, request):
        self._writer.write(request)

    def reply(self, accept=lambda reply: True):
        return next_sample(self._reader, accept)

    def call(self, request):
        self.send(request)
        return self.reply()

    def first_reply(self, request):
        """The first reply; repeats the request every second, because an early one is lost."""
        for _ in range(MAX_TRIES):
            self.send(request)
            for reply in self._reader.take_iter(timeout=duration(seconds=1)):
                return reply
        raise TimeoutError(f"no reply on {self._reader.topic.name}")
