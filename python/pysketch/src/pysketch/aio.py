"""Satellites in asyncio (Python 3). Without the syntax of coroutines, so that Python 2 can read the file too.

    import asyncio
    from pysketch import FlowSat
    from pysketch.aio import AsyncSat

    async def main():
        async with AsyncSat(FlowSat()) as sat:
            print(await sat.call("robot.gripper", {"open": True}))
            async for message in sat.messages("robot.imu"):
                print(message.value)

    asyncio.run(main())
"""

import asyncio
from collections import deque

from .pulse import look

WAITING_MAX = 1024


class AsyncSat(object):
    """Runs a satellite in the event loop that is running: its `loop` is called each interval, and what the hub sends is
    handled when it comes. To connect takes a moment in which the event loop waits; a hub on this machine is no such
    moment away."""

    def __init__(self, sat):
        self.sat, self._loop, self._file, self._writes, self._timer = sat, None, None, False, None
        self._ready, self._over, self._listening = None, None, []

    def start(self):
        """Begins; the future that this answers is done when the hub has let the satellite in."""
        self._loop = asyncio.get_event_loop()
        self._ready, self._over = self._loop.create_future(), self._loop.create_future()
        self._tick()
        return self._ready

    def close(self):
        """Ends it."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._unwatch()
        self.sat.close()
        for messages in self._listening:
            messages.end()
        if self._over is not None and not self._over.done():
            self._over.set_result(None)

    def wait_closed(self):
        """A future that is done when the satellite has ended; it raises what ended it."""
        return self._over

    def __aenter__(self):
        entered = asyncio.get_event_loop().create_future()

        def ready(future):
            if future.cancelled() or entered.done():
                return
            if future.exception() is not None:
                entered.set_exception(future.exception())
            else:
                entered.set_result(self)
        self.start().add_done_callback(ready)
        return entered

    def __aexit__(self, *_):
        self.close()
        return self._over

    def call(self, name, value, within=5.0):
        """A future of the answer of the service of this full name; it raises `Refused`."""
        future = self._loop.create_future()

        def then(reply):
            if future.done():
                return
            if reply.ok:
                future.set_result(reply.value)
            else:
                future.set_exception(reply.error)
        call = self.sat.call(name, value, then, within)
        future.add_done_callback(lambda done: call.cancel() if done.cancelled() else None)
        self._loop.call_soon(self._turn)
        return future

    def get(self, database, key):
        """A future of a variable of this database; it raises `Refused`."""
        future = self._loop.create_future()

        def then(value, error):
            if not future.done():
                future.set_exception(error) if error is not None else future.set_result(value)
        self.sat.database(database).get(key, then)
        self._loop.call_soon(self._turn)
        return future

    def messages(self, name, **wishes):
        """An asynchronous iterator over the messages of the channel of this full name."""
        messages = Messages(self, name, wishes)
        self._listening.append(messages)
        return messages

    def forget(self, messages):
        """For messages that were closed."""
        if messages in self._listening:
            self._listening.remove(messages)

    # ---- turns ----

    def _tick(self):
        self._timer = self._loop.call_later(self.sat.pulse.interval, self._tick)
        self._turn(True)

    def _turn(self, tick=False):
        flow = self.sat.flow
        if self._over.done():
            return
        try:
            if flow.connection is None:
                flow.find_hub()
            readable = writable = False
            if flow.connection is not None:
                readable, writable = look(flow.connection.link, flow.connection.waiting > 0, 0)
            self.sat.round(tick, readable, writable)
        except Exception as error:
            return self._fail(error)
        if self.sat.ready and not self._ready.done():
            self._ready.set_result(self)
        self._watch()

    def _fail(self, error):
        if not self._ready.done():
            self._ready.set_exception(error)
            self._over.set_result(None)
        elif not self._over.done():
            self._over.set_exception(error)
        self.close()

    def _watch(self):
        connection = self.sat.flow.connection
        file = connection.link.fileno() if connection is not None else None
        if file != self._file:
            self._unwatch()
            if file is not None:
                self._loop.add_reader(file, self._turn)
            self._file = file
        wants = connection is not None and connection.link.watches(connection.waiting > 0)
        if wants != self._writes and file is not None:
            if wants:
                self._loop.add_writer(file, self._turn)
            else:
                self._loop.remove_writer(file)
            self._writes = wants

    def _unwatch(self):
        if self._file is not None:
            self._loop.remove_reader(self._file)
            self._loop.remove_writer(self._file)
        self._file, self._writes = None, False


class Messages(object):
    """See `AsyncSat.messages`. At most 1,024 wait; the oldest go first and are counted in `lost`."""

    def __init__(self, sat, name, wishes):
        self._sat, self._name, self._waiting, self._next, self.lost = sat, name, deque(), None, 0
        self._over = False
        sat.sat.subscribe(name, self._hear, **wishes)

    def _hear(self, message):
        if self._next is not None and not self._next.done():
            return self._next.set_result(message)
        if len(self._waiting) >= WAITING_MAX:
            self._waiting.popleft()
            self.lost += 1
        self._waiting.append(message)

    def __aiter__(self):
        return self

    def __anext__(self):
        if self._over:
            raise StopAsyncIteration
        self._next = asyncio.get_event_loop().create_future()
        if self._waiting:
            self._next.set_result(self._waiting.popleft())
        return self._next

    def close(self):
        """Hears no more: who waits for a message waits no longer."""
        self._sat.forget(self)
        self._sat.sat.unsubscribe(self._name)
        self.end()

    def end(self):
        """For the satellite: no more will come."""
        self._over = True
        if self._next is not None and not self._next.done():
            self._next.set_exception(StopAsyncIteration())
