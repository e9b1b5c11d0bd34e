"""A client of `condor view` that shares nothing with it: websockets, and the CDR of mcap-ros2-support.

    python viewer.py CONDOR LOOP PARAMETER      (pip install websockets mcap-ros2-support)

CONDOR is a program with the commands of `condor` that knows a system and a robot. It is started, and
then looked at: the rows of LOOP, the robot, and PARAMETER, which is raised by an eighth. Each check
that holds is a line `kept`.
"""

import asyncio
import contextlib
import itertools
import json
import os
import re
import struct
import sys
import tempfile
import xml.etree.ElementTree

import websockets
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

PATIENCE_S = 60


def keep(what):
    print(f"{what}\nkept", flush=True)


class Viewer:
    """A connected client."""

    def __init__(self, socket):
        self.socket = socket
        self.waiting = []
        self.decoders = {}

    @classmethod
    @contextlib.asynccontextmanager
    async def connect(cls, url, subprotocol="foxglove.sdk.v1", **options):
        async with websockets.connect(url, subprotocols=[subprotocol], **options) as socket:
            assert socket.subprotocol == subprotocol, socket.subprotocol
            viewer = cls(socket)
            viewer.info = await viewer.answer("serverInfo")
            channels = (await viewer.answer("advertise"))["channels"]
            viewer.channels = {channel["topic"]: channel for channel in channels}
            yield viewer

    async def send(self, **message):
        await self.socket.send(json.dumps(message))

    async def receive(self, wanted):
        """The first message that is wanted; others stay for later."""
        for place, message in enumerate(self.waiting):
            if wanted(message):
                return self.waiting.pop(place)
        while True:
            message = await self.socket.recv()
            if isinstance(message, str):
                message = json.loads(message)
            if wanted(message):
                return message
            self.waiting.append(message)

    async def answer(self, op, **fields):
        def wanted(message):
            return isinstance(message, dict) and message["op"] == op and fields.items() <= message.items()

        return await self.receive(wanted)

    async def status(self, text):
        status = await self.receive(
            lambda it: isinstance(it, dict) and it["op"] == "status" and text in it["message"]
        )
        return status["level"]

    async def subscribe(self, number, topic):
        channel = self.channels[topic]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg"), channel
        schema = Schema(
            id=1, name=channel["schemaName"], encoding="ros2msg", data=channel["schema"].encode()
        )
        self.decoders[number] = DecoderFactory().decoder_for("cdr", schema)
        await self.send(op="subscribe", subscriptions=[{"id": number, "channelId": channel["id"]}])

    async def data(self, number):
        """The next message of a subscription."""
        begin = struct.pack("<BI", 1, number)
        message = await self.receive(lambda it: isinstance(it, bytes) and it.startswith(begin))
        return self.decoders[number](message[13:])

    async def get(self, name):
        await self.send(op="getParameters", parameterNames=[name], id="get")
        values = await self.answer("parameterValues", id="get")
        return values["parameters"][0]["value"]

    async def set(self, name, value):
        parameters = [{"name": name, "value": value, "type": "float64"}]
        await self.send(op="setParameters", parameters=parameters, id="set")


async def look(url, query, loop, parameter):
    for name in ["foxglove.sdk.v1", "foxglove.websocket.v1"]:
        async with Viewer.connect(url, subprotocol=name) as viewer:
            assert "parameters" in viewer.info["capabilities"], viewer.info
    keep("both names of the subprotocol")

    for headers in [{"Origin": "https://evil.example"}, {"Host": "evil.example"}]:
        try:
            async with Viewer.connect(url, additional_headers=headers):
                raise AssertionError(f"{headers} may connect")
        except websockets.InvalidStatus as refused:
            assert refused.response.status_code == 403, refused
    keep("a foreign origin and a foreign host are refused")

    async with (
        Viewer.connect(url) as viewer,
        Viewer.connect(url + query) as setter,
        Viewer.connect(url, max_queue=1) as slow,
    ):
        # It never reads again.
        for number, topic in enumerate(slow.channels):
            await slow.subscribe(number, topic)

        await viewer.subscribe(1, loop)
        last = None
        for _ in range(1000):
            row = await viewer.data(1)
            if last is not None:
                assert row.tick == last + row.lost + 1, (row.tick, last, row.lost)
            last = row.tick
        await viewer.send(op="unsubscribe", subscriptionIds=[1])
        keep("rows of successive ticks, while another client reads nothing")

        await setter.subscribe(1, "/robot_description")
        await setter.subscribe(2, "/joint_states")
        await setter.subscribe(3, "/tf")
        urdf = xml.etree.ElementTree.fromstring((await setter.data(1)).data)
        links = {link.get("name") for link in urdf.iter("link")}
        joints = {joint.get("name") for joint in urdf.iter("joint")}
        frames = {one.child_frame_id for one in (await setter.data(3)).transforms}
        assert frames and frames < links, (frames, links)
        moving = {one.get("name") for one in urdf.iter("joint") if one.get("type") != "fixed"}
        seen = set()
        while seen != moving:
            state = await setter.data(2)
            assert len(state.position) == len(state.name), state
            seen |= set(state.name)
            assert seen <= joints, (seen, joints)
        await setter.send(op="unsubscribe", subscriptionIds=[2, 3])
        keep(f"a model of {len(links)} links, their frames, and the states of {len(seen)} joints")

        before = await viewer.get(parameter)
        after = before + 0.125
        await viewer.send(op="subscribeParameterUpdates", parameterNames=[parameter])
        await viewer.answer("parameterValues")
        await viewer.set(parameter, after)
        assert await viewer.status("without the token") == 2
        refused = await viewer.answer("parameterValues", id="set")
        assert refused["parameters"][0]["value"] == before, refused
        assert await viewer.get(parameter) == before
        await setter.set(parameter, after)
        values = await setter.answer("parameterValues", id="set")
        assert values["parameters"][0]["value"] == after, values
        update = await viewer.answer("parameterValues")
        assert update["parameters"][0]["value"] == after, update
        keep("a parameter is set by the token alone, and the others are told")

        for garbage in ["", "{", '{"op":"x"}', b"\x01", b""]:
            await viewer.socket.send(garbage)
            complaint = "cannot understand" if isinstance(garbage, str) else "cannot publish"
            assert await viewer.status(complaint) == 2
        assert await viewer.get(parameter) == after
        keep("garbage is answered")


async def line(stream):
    read = await stream.readline()
    assert read, "the program has ended"
    return read.decode().strip()


async def main(condor, loop, parameter):
    with tempfile.TemporaryDirectory() as place:
        environment = os.environ | {"XDG_RUNTIME_DIR": place}

        async def start(*arguments, **options):
            pipe = asyncio.subprocess.PIPE
            return await asyncio.create_subprocess_exec(
                condor, *arguments, env=environment, stdin=asyncio.subprocess.DEVNULL, **{"stdout": pipe} | options
            )

        up = await start("--headless", stderr=asyncio.subprocess.PIPE, stdout=None)
        try:
            while "have been started" not in await line(up.stderr):
                pass
            rest = asyncio.create_task(up.stderr.read())
            code = None
            while code != 0:
                # Its program may be about to show it.
                get = await start("vars", "get", parameter, stderr=asyncio.subprocess.DEVNULL)
                await get.communicate()
                code = get.returncode
            live = await start("view", "--port", "0")
            url, setting = [
                next(word for word in (await line(live.stdout)).split() if word.startswith("ws://"))
                for _ in range(2)
            ]
            query = setting.removeprefix(url)
            await look(url, query, loop, parameter)
            live.terminate()
            summary = (await live.communicate())[0].decode()
            lost = re.search(r"samples: (\d+) sent, (\d+) lost", summary)
            assert live.returncode == 0 and lost and int(lost[2]) > 0, summary
            keep(f"{lost[2]} samples are counted as lost by the client that read nothing")
        finally:
            up.terminate()
            await up.wait()
            await rest


if __name__ == "__main__":
    asyncio.run(asyncio.wait_for(main(*sys.argv[1:]), PATIENCE_S))
