"""Databases: with variants, and with their twins in JSON alone."""

import unittest

from hub import HubTest, Hub, Patience
from pysketch import FlowSat, Refused, Sketch, connect


class Databases(HubTest):
    """In the form of variants."""

    form = "variant"

    def setUp(self):
        HubTest.setUp(self)
        self.name = "d-%s-%s" % (self.form, self.id().rpartition(".")[2].replace("_", "-"))
        self.name = self.name[:60]

    def database(self):
        """A satellite and its database."""
        sat = self.sat(form=self.form)
        return sat, sat.database(self.name).create()

    def test_variables_are_set_read_listed_and_deleted(self):
        values = {u"gain": 1.5, u"name": u"arm \u00e4", u"list": [1, None, True], u"map": {u"x": -3}}
        with connect(self.hub.unix, form=self.form) as hub:
            hub.create_database(self.name)
            self.assertTrue(hub.has_database(self.name))
            hub.select(self.name)
            for key, value in values.items():
                hub.set(key, value)
            self.assertEqual(hub.all(), values)
            self.assertEqual((hub.get("gain"), hub.keys("na")), (1.5, [u"name"]))
            hub.delete("gain")
            self.assertFalse(hub.has("gain"))
            with self.assertRaises(Refused) as caught:
                hub.get("gain")
            self.assertEqual(caught.exception.code, "NoSuchVariable")
            self.assertIn((self.name, False, 3), [entry[:3] for entry in hub.databases("d-")])
            hub.remove_database(self.name)
            self.assertFalse(hub.has_database(self.name))

    def test_a_satellite_sets_and_hears_its_watch(self):
        sat, database = self.database()
        heard, done = [], []
        self.until(lambda: sat.ready, sat)
        watch = database.watch("gain.", heard.append)
        database.set("gain.p", 2.5, done.append)
        database.set("other", 1)
        self.until(lambda: heard and done, sat)
        self.assertEqual((heard[0].key, heard[0].value, done), (u"gain.p", 2.5, [None]))
        database.delete("gain.p")
        self.until(lambda: len(heard) == 2, sat)
        self.assertTrue(heard[1].deleted)
        self.assertEqual(watch.values, {})
        watch.cancel()
        self.until(lambda: not sat.waiting, sat)

    def test_a_satellite_asks_for_variables(self):
        sat, database = self.database()
        self.until(lambda: sat.ready, sat)
        database.set("a.x", [1, {u"y": None}])
        database.set("a.z", True)
        got = []
        database.get("a.x", lambda *found: got.append(found))
        database.get("nothing", lambda *found: got.append(found))
        database.all("a.", lambda *found: got.append(found))
        self.until(lambda: len(got) == 3, sat)
        self.assertEqual(got[0], ([1, {u"y": None}], None))
        self.assertEqual((got[1][0], got[1][1].code), (None, "NoSuchVariable"))
        self.assertEqual(got[2], ({u"a.x": [1, {u"y": None}], u"a.z": True}, None))

    def test_two_databases_are_told_apart(self):
        sat = self.sat(form=self.form)
        one, two = [sat.database(self.name + suffix).create() for suffix in ("-1", "-2")]
        self.until(lambda: sat.ready, sat)
        got = []
        for turn in range(3):
            one.set("k", turn)
            two.set("k", 10 * turn)
        one.get("k", lambda value, _: got.append(value))
        two.get("k", lambda value, _: got.append(value))
        self.until(lambda: len(got) == 2, sat)
        self.assertEqual(got, [2, 20])

    def test_a_database_that_is_not_there_is_refused_with_its_reason(self):
        sat, refusals = self.sat(form=self.form), []
        self.until(lambda: sat.ready, sat)
        sat.database("nowhere-" + self.form).set("k", 1, refusals.append)
        self.until(lambda: refusals, sat)
        self.assertEqual(refusals[0].code, "NoDatabase")

    def test_the_decorator_watches_before_there_is_anything(self):
        sketch, heard = self.keep(Sketch(self.hub.unix, interval=0.01, form=self.form)), []

        @sketch.watch(self.name, "speed")
        def on_speed(variable):
            heard.append(variable.value)
        self.until(lambda: sketch.ready, sketch)
        with connect(self.hub.unix) as hub:
            hub.create_database(self.name)
            hub.select(self.name).set("speed", 4)
        self.until(lambda: heard == [4], sketch)

    def test_channels_and_properties_travel_too(self):
        sat = self.sat(form=self.form)
        stream, got = sat.stream("twin-" + self.form, format="json", unit="m"), []
        sat.subscribe("robot.twin-" + self.form, lambda message: got.append(message))
        self.until(lambda: stream.listened, sat)
        stream.publish({u"x": [1, u"\u00e4"]})
        self.until(lambda: got, sat)
        self.assertEqual(got[0].value, {u"x": [1, u"\u00e4"]})
        self.assertEqual(got[0].channel.properties, {u"format": u"json", u"unit": u"m"})


class Twins(Databases):
    """The same, with no variant on the wire."""

    form = "json"

    def test_not_one_variant_is_written_or_read(self):
        from pysketch import variant
        written, read = variant.encode, variant.decode

        def never(*_):
            raise AssertionError("a variant in its binary form")
        variant.encode = variant.decode = never
        try:
            sat, database = self.database()
            heard = []
            self.until(lambda: sat.ready, sat)
            database.watch("", heard.append)
            database.set("k", {u"a": 1})
            self.until(lambda: heard, sat)
            self.assertEqual(heard[0].value, {u"a": 1})
        finally:
            variant.encode, variant.decode = written, read


class OwnDatabase(HubTest):
    """What a satellite says of itself."""

    def test_the_pulse_is_told_with_its_statistics(self):
        sat = self.sat(interval=0.02, name="pacer")
        self.until(lambda: sat.ready, sat)
        with connect(self.hub.unix) as hub:
            hub.select("flow:robot.pacer")

            def told():
                sat.pulse_once()
                return hub.has("pulse.statistics") and hub.get("pulse.statistics")[u"ticks"] > 3
            self.patiently(told)
            self.assertEqual((hub.get("pulse.interval_ms"), hub.get("pulse.mode")), (20.0, u"Coarse"))
            found = hub.get("pulse.statistics")
            self.assertLessEqual(found[u"wake_error"][u"p50"], found[u"wake_error"][u"max"])
            self.assertGreater(found[u"wake_error"][u"max"], 0)
            sat.pulse.change("realtime", 0.01)
            self.patiently(lambda: sat.pulse_once() or hub.get("pulse.mode") == u"Realtime")


class Durability(Patience):
    """A hub that is killed."""

    def test_what_was_saved_is_there_again_and_a_watch_goes_on(self):
        hub = self.keep_hub(Hub("--without", "host"))
        sat, heard, done = FlowSat(hub.unix, interval=0.01), [], []
        database = sat.database("calibration").create(durable=True)
        self.until(lambda: sat.ready, sat)
        watch = database.watch("", lambda variable: heard.append((variable.key, variable.value)))
        database.set("offset", 3, done.append)
        self.until(lambda: done and heard, sat)
        hub.kill()
        self.until(lambda: not sat.ready, sat)
        hub.start()
        self.until(lambda: sat.ready and watch.in_force, sat)
        database.set("offset", 4)
        self.until(lambda: len(heard) == 2, sat)
        self.assertEqual(heard, [(u"offset", 3), (u"offset", 4)])
        sat.close()


if __name__ == "__main__":
    unittest.main()
