"""Satellites in asyncio, where there is one."""

import sys
import unittest

from hub import PATIENCE_S, HubTest
from pysketch import FlowSat, LinkError, Refused


@unittest.skipIf(sys.version_info < (3, 6), "asyncio is of Python 3")
class Asyncio(HubTest):
    """The event loop runs the satellite. Written without the syntax of coroutines, for the sake of Python 2."""

    def run_all(self, make):
        """Runs the steps of a generator: each future that it yields, one after the other."""
        import asyncio
        loop = asyncio.new_event_loop()
        self.addCleanup(loop.close)
        asyncio.set_event_loop(loop)
        self.addCleanup(asyncio.set_event_loop, None)
        outcome, steps = loop.create_future(), make()

        def step(future=None):
            try:
                error = future.exception() if future is not None else None
                if error is not None:
                    waited = steps.throw(error)
                else:
                    waited = steps.send(future.result() if future is not None else None)
                waited.add_done_callback(step)
            except StopIteration:
                outcome.set_result(None)
            except BaseException as error:
                outcome.set_exception(error)
        # From within the loop, so that it is the one that is running.
        loop.call_soon(step)
        loop.run_until_complete(asyncio.wait_for(outcome, PATIENCE_S))

    def test_calls_and_messages_are_awaited(self):
        from pysketch.aio import AsyncSat

        def steps():
            inner = FlowSat(self.hub.unix, interval=0.01)
            numbers = inner.stream("numbers")
            inner.loop = lambda: numbers.publish(7)
            inner.serve("half", lambda request: request.value / 2.0)
            sat = yield AsyncSat(inner).__aenter__()
            answer = yield sat.call("robot.half", 3)
            self.assertEqual(answer, 1.5)
            messages = sat.messages("robot.numbers")
            for _ in range(3):
                message = yield messages.__anext__()
                self.assertEqual((message.name, message.value), ("robot.numbers", 7))
            with self.assertRaises(Refused):
                yield sat.call("robot.nobody", 1, within=0.1)
            inner.database("tea").create()
            inner.database("tea").set("sugar", 2)
            value = yield sat.get("tea", "sugar")
            self.assertEqual(value, 2)
            yield sat.__aexit__(None, None, None)
            with self.assertRaises(StopAsyncIteration):  # noqa: F821
                messages.__anext__()
        self.run_all(steps)

    def test_who_waits_for_a_message_does_not_wait_for_ever(self):
        from pysketch.aio import AsyncSat
        # In the syntax that users write, which Python 2 cannot read.
        names = {}
        exec("async def listen(messages, seen):\n"
             "    async for message in messages:\n"
             "        seen.append(message.value)\n"
             "    seen.append('over')\n", names)

        def steps():
            import asyncio
            inner, seen = FlowSat(self.hub.unix, interval=0.01), []
            once = inner.stream("once", latch=True)
            sat = yield AsyncSat(inner).__aenter__()
            tasks = [asyncio.ensure_future(names["listen"](sat.messages(name), seen)) for name in ("robot.once", "robot.never")]
            closed = sat.messages("robot.closed")
            tasks.append(asyncio.ensure_future(names["listen"](closed, seen)))
            while not once.wanted:
                yield asyncio.ensure_future(asyncio.sleep(0))
            once.publish(1)
            while not seen:
                yield asyncio.ensure_future(asyncio.sleep(0))
            self.assertEqual(seen, [1])
            closed.close()
            yield tasks[2]
            yield sat.__aexit__(None, None, None)
            for task in tasks[:2]:
                yield task
            self.assertEqual(seen, [1, "over", "over", "over"])
        self.run_all(steps)

    def test_a_hub_that_is_not_there_is_an_error(self):
        from pysketch.aio import AsyncSat

        def steps():
            with self.assertRaises(LinkError):
                yield AsyncSat(FlowSat("unix:/nowhere/hub.sock", reconnect=False)).__aenter__()
        self.run_all(steps)


if __name__ == "__main__":
    unittest.main()
