"""Logins: by the owner's token, by the user of a Unix socket, or by name and password (SCRAM-SHA-256).

Neither the token nor the password ever crosses the wire; both sides prove that they know it.
"""

import base64
import hashlib
import hmac
import os
import re

from .variant import TEXT

CLIENT_LABEL = b"SpecialK flow 1 client"
HUB_LABEL = b"SpecialK flow 1 hub"
ROUNDS_MIN, ROUNDS_MAX = 15000, 1000000
# What a new password is stretched by.
ROUNDS, SALT_BYTES = ROUNDS_MIN, 16


class LoginError(Exception):
    """The login cannot be, or the hub could not prove itself."""


def hmac_sha256(key, message):
    """HMAC-SHA-256, as bytes."""
    return hmac.new(key, message, hashlib.sha256).digest()


def same(one, other):
    """Whether two secrets are equal, in constant time."""
    return hmac.compare_digest(bytes(one), bytes(other))


class Peer(object):
    """Logs in as the user of this process, over a Unix socket."""


class Token(object):
    """Logs in by the owner's token: 32 bytes."""

    def __init__(self, secret):
        if len(secret) != 32:
            raise LoginError("a token has 32 bytes, not %d" % len(secret))
        self.secret = bytes(secret)

    @classmethod
    def read(cls, path):
        """The token in a file of the hub's state folder; the file must be readable by its owner alone."""
        try:
            mode = os.stat(path).st_mode
            with open(path, "rb") as file:
                text = file.read(256)
        except (IOError, OSError) as error:
            raise LoginError("the owner's token cannot be read: %s" % error)
        if mode & 0o077:
            raise LoginError("%s has mode %03o, so others may have read the token" % (path, mode & 0o777))
        if not re.match(br"\A[0-9a-fA-F]{64}\r?\n?\Z", text):
            raise LoginError("%s is not a token: 64 hexadecimal digits are expected" % path)
        return cls(bytes(bytearray.fromhex(text[:64].decode("ascii"))))

    def client_proof(self, client_nonce, hub_nonce):
        """What the client sends."""
        return hmac_sha256(self.secret, CLIENT_LABEL + client_nonce + hub_nonce)

    def hub_proof(self, client_nonce, hub_nonce):
        """What a true hub sends."""
        return hmac_sha256(self.secret, HUB_LABEL + hub_nonce + client_nonce)


class Password(object):
    """Logs in by name and password: SCRAM-SHA-256 (RFC 5802, RFC 7677). The derived key is kept for as long
    as this object lives, so that a reconnection costs nothing."""

    def __init__(self, user, password):
        self.user = user
        self._password = password.encode("utf-8") if isinstance(password, TEXT) else bytes(password)
        self._keys = {}

    def begin(self, nonce):
        """The client-first-message; `nonce` are random bytes."""
        name = self.user.replace("=", "=3D").replace(",", "=2C")
        self._nonce = base64.b64encode(nonce).decode("ascii").replace(",", "")
        self._first = "n=%s,r=%s" % (name, self._nonce)
        return "n,," + self._first

    def prove(self, challenge):
        """The client-final-message that answers the server-first-message."""
        found = re.match(r"\Ar=([!-+\--~]+),s=([A-Za-z0-9+/=]+),i=([0-9]+)\Z", challenge)
        if not found or not found.group(1).startswith(self._nonce) or found.group(1) == self._nonce:
            raise LoginError("the hub's challenge is not one")
        nonce, salt, rounds = found.group(1), base64.b64decode(found.group(2)), int(found.group(3))
        if not ROUNDS_MIN <= rounds <= ROUNDS_MAX:
            raise LoginError("the hub asks for %d rounds" % rounds)
        salted = self._keys.get((salt, rounds))
        if salted is None:
            salted = hashlib.pbkdf2_hmac("sha256", self._password, salt, rounds)
            self._keys[(salt, rounds)] = salted
        final = "c=biws,r=" + nonce
        signed = ",".join((self._first, challenge, final)).encode("utf-8")
        client_key = hmac_sha256(salted, b"Client Key")
        signature = hmac_sha256(hashlib.sha256(client_key).digest(), signed)
        self._server_signature = hmac_sha256(hmac_sha256(salted, b"Server Key"), signed)
        proof = bytes(bytearray(a ^ b for a, b in zip(bytearray(client_key), bytearray(signature))))
        return "%s,p=%s" % (final, base64.b64encode(proof).decode("ascii"))

    def hub_is_true(self, signature):
        """Whether the hub knows the password's verifier."""
        return same(self._server_signature, signature)


def verifier(password, salt, rounds=ROUNDS):
    """What the hub keeps of a password: (stored key, server key), 32 bytes each."""
    raw = password.encode("utf-8") if isinstance(password, TEXT) else bytes(password)
    salted = hashlib.pbkdf2_hmac("sha256", raw, salt, rounds)
    stored = hashlib.sha256(hmac_sha256(salted, b"Client Key")).digest()
    return stored, hmac_sha256(salted, b"Server Key")


def state_folder():
    """The folder of a hub's state, as the hub itself finds it."""
    for variable, below in (("SKROBOT_STATE_DIR", ""), ("XDG_STATE_HOME", "skrobot"), ("HOME", ".local/state/skrobot")):
        value = os.environ.get(variable, "")
        if os.path.isabs(value):
            return os.path.join(value, below) if below else value
    raise LoginError("no folder for the hub's state: set HOME, XDG_STATE_HOME or SKROBOT_STATE_DIR")
