"""Services: answering, asking, streaming to one asker, and every way in which there is no answer."""

import unittest

from hub import HubTest
from pysketch import Refused, Sketch, connect


class Services(HubTest):
    """A server and an asker."""

    def ask(self, *arguments, **settings):
        """Calls; answers the list in which the replies come."""
        replies = []
        self.asker.call(*(arguments + (replies.append,)), **settings)
        return replies

    def setUp(self):
        HubTest.setUp(self)
        self.server, self.asker = self.sat(), self.sat()

    def both(self, reached):
        self.until(reached, self.server, self.asker)

    def test_what_a_function_returns_is_the_answer(self):
        self.server.serve("double", lambda request: 2 * request.value)
        replies = self.ask("robot.double", 21)
        self.both(lambda: replies)
        self.assertTrue(replies[0].ok)
        self.assertEqual(replies[0].value, 42)

    def test_a_service_that_comes_later_is_waited_for(self):
        replies = self.ask("robot.late", None, within=60)
        self.until(lambda: self.asker.ready, self.asker)
        self.server.serve("late", lambda request: u"here")
        self.both(lambda: replies)
        self.assertEqual(replies[0].value, u"here")

    def test_large_questions_and_answers_come_whole(self):
        self.server.serve("echo", lambda request: request.answer_bytes(request.payload))
        replies, payload = [], bytes(bytearray(range(256))) * 2000
        self.asker.call_bytes("robot.echo", payload, replies.append, within=60)
        self.both(lambda: replies)
        self.assertEqual(replies[0].payload, payload)

    def test_a_service_streams_to_one_asker(self):
        def count(request):
            for number in range(request.value):
                request.answer(number, more=True)
            request.answer(u"done")
        self.server.serve("count", count)
        replies = self.ask("robot.count", 3)
        self.both(lambda: replies and not replies[-1].more)
        self.assertEqual([reply.value for reply in replies], [0, 1, 2, u"done"])

    def test_an_answer_may_come_later(self):
        waiting = []
        self.server.serve("later", waiting.append)
        replies = self.ask("robot.later", 1)
        self.both(lambda: waiting)
        self.assertEqual(replies, [])
        waiting[0].answer(u"now")
        self.both(lambda: replies)
        self.assertEqual(replies[0].value, u"now")

    def test_each_way_without_an_answer_has_its_name(self):
        def broken(request):
            raise KeyError("no arm")
        self.server.serve("broken", broken)
        self.server.serve("mute", lambda request: None)
        self.server.serve("busy", lambda request: request.decline(u"busy"))
        replies = [self.ask("robot.broken", 1), self.ask("robot.mute", 1, within=0.05), self.ask("robot.busy", 1),
                   self.ask("robot.nowhere", 1, within=0.05)]
        self.both(lambda: all(replies))
        errors = [found[0].error for found in replies]
        self.assertEqual([error.code for error in errors], ["Declined", "NoAnswer", "Declined", "NoSuchService"])
        self.assertIn("no arm", errors[0].text)
        self.assertIn("busy", errors[2].text)
        self.assertRaises(Refused, lambda: replies[0][0].value)

    def test_an_answer_that_cannot_be_sent_is_declined(self):
        self.server.serve("odd", lambda request: {1: object()})
        replies = self.ask("robot.odd", None)
        self.both(lambda: replies)
        self.assertEqual(replies[0].error.code, "Declined")
        self.assertIn("VariantError", replies[0].error.text)

    def test_the_owner_hears_that_nobody_waits(self):
        waiting = []
        self.server.serve("slow", waiting.append)
        call = self.asker.call("robot.slow", 1, self.fail)
        self.both(lambda: waiting)
        call.cancel()
        self.both(lambda: waiting[0].over)
        waiting[0].answer(u"nobody hears this")
        self.assertFalse(waiting[0].done)

    def test_a_connection_without_a_flow_asks_too(self):
        sketch = self.keep(Sketch(self.hub.unix, interval=0.01))

        @sketch.serve("sum", format="json")
        def add(request):
            for number in request.value:
                request.answer(number, more=True)
            return sum(request.value)
        self.until(lambda: sketch.flow.own["sum"].opened, sketch)
        with self.pulsing(sketch), connect(self.hub.unix) as hub:
            self.assertEqual(hub.call("robot.sum", [1, 2, 3]), 6)
            self.assertEqual(list(hub.call_all("robot.sum", [1, 2])), [1, 2, 3])
            with self.assertRaises(Refused) as caught:
                hub.call("robot.nobody", 1)
            self.assertEqual(caught.exception.code, "NoSuchService")

    def test_answers_that_nobody_waits_for_do_not_stand_in_the_way(self):
        sketch = self.keep(Sketch(self.hub.unix, interval=0.01))

        @sketch.serve("count")
        def count(request):
            for number in range(request.value):
                request.answer(number, more=True)
            return u"done"
        self.until(lambda: sketch.flow.own["count"].opened, sketch)
        with self.pulsing(sketch), connect(self.hub.unix) as hub:
            hub.select("user:robot")
            for number in hub.call_all("robot.count", 100):
                break
            self.assertEqual(number, 0)
            self.assertEqual(hub.call("robot.count", 0), u"done")
            # The database is still the current one.
            self.assertGreater(hub.get("hub.flows"), 0)


if __name__ == "__main__":
    unittest.main()
