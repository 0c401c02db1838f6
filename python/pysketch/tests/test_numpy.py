"""Views of numeric payloads, where there is numpy."""

import unittest

from hub import HubTest

try:
    import numpy
except ImportError:
    numpy = None


@unittest.skipIf(numpy is None, "there is no numpy")
class Views(HubTest):
    """Without a copy."""

    def test_a_payload_is_seen_in_its_shape(self):
        sat, got = self.sat(), []
        stream = sat.stream("image", format="<f4", shape=[2, 3])
        sat.subscribe("robot.image", got.append)
        self.until(lambda: stream.listened, sat)
        sent = numpy.arange(6, dtype="<f4").reshape(2, 3)
        stream.publish_bytes(sent.tobytes())
        self.until(lambda: got, sat)
        self.assertTrue((got[0].array() == sent).all())
        self.assertFalse(got[0].array().flags.owndata)

    def test_its_numbers_and_arrays_are_values(self):
        sat, got = self.sat(), []
        stream = sat.stream("values")
        sat.subscribe("robot.values", lambda message: got.append(message.value))
        self.until(lambda: stream.listened, sat)
        stream.publish({u"x": numpy.float32(1.5), u"y": numpy.arange(3), u"z": numpy.int64(4)})
        self.until(lambda: got, sat)
        self.assertEqual(got, [{u"x": 1.5, u"y": [0, 1, 2], u"z": 4}])


if __name__ == "__main__":
    unittest.main()
