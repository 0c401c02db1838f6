"""Accounts: login by name and password, at a real hub."""

import unittest

from hub import HubTest
from pysketch import FlowSat, LoginError, Refused, connect


class Accounts(HubTest):
    """An owner who adds an account, and its user."""

    def test_a_user_logs_in_with_a_password_and_has_no_rights_at_first(self):
        with connect(self.hub.unix) as owner:
            owner.set_user("guest", u"s\u00e9same")
            self.assertIn(u"guest", [name for name, _ in owner.users()])
        with connect(self.hub.tcp, ("guest", u"s\u00e9same")) as guest:
            self.assertEqual(guest.user, u"guest")
            self.assertRaises(Refused, guest.set_user, "other", "x")
        self.assertRaises(LoginError, connect, self.hub.tcp, ("guest", "wrong"))
        refusals = []
        sat = self.keep(FlowSat(self.hub.tcp, credentials=("guest", u"s\u00e9same"), interval=0.01))
        sat.on_refused = refusals.append
        sat.stream("mine")
        self.until(lambda: refusals, sat)
        self.assertEqual((refusals[0].code, refusals[0].about), ("Denied", "mine"))
        with connect(self.hub.unix) as owner:
            owner.select("user:guest").set("right.publish", "*")
            owner.remove_user("guest")
        self.until(lambda: not sat.ready or not refusals, sat)

    def test_who_may_use_no_database_is_not_told_so_again_and_again(self):
        with connect(self.hub.unix) as owner:
            owner.set_user("mute", "word")
        refusals = []
        sat = self.keep(FlowSat(self.hub.tcp, credentials=("mute", "word"), interval=0.01))
        sat.on_refused = refusals.append
        self.until(lambda: sat.ready, sat)
        # What a satellite tells of itself is on its way before this, and refused before it.
        sat.stream("mine")
        self.until(lambda: refusals, sat)
        self.assertEqual([(refusal.code, refusal.about) for refusal in refusals], [("Denied", "mine")])


if __name__ == "__main__":
    unittest.main()
