"""Blob channels: files that the hub keeps for a satellite, and that others download."""

import os
import zlib

from .channels import OwnChannel
from .connection import Refused
from .frames import as_bytes

# One command reads or writes so much: several fragments, and little that is lost with a link.
PIECE_BYTES = 256 * 1024


class FileInfo(object):
    """An entry of a blob channel: `name` (or path), `directory`, `bytes`, and `checksum`, the CRC-32 of a file (None in
    a list)."""

    __slots__ = ("name", "directory", "bytes", "checksum")

    def __init__(self, name, directory, size, checksum=None):
        self.name, self.directory, self.bytes, self.checksum = name, bool(directory), size, checksum

    def __repr__(self):
        return "<%s %s, %d bytes>" % ("directory" if self.directory else "file", self.name, self.bytes)


class Store(OwnChannel):
    """A blob channel of one's own. Paths have at most 16 parts of `A-Z a-z 0-9 _ . -`. Each `then(error)` is called once,
    with None when the hub's disk has it."""

    command = "create_blob"

    def __init__(self, flow, name, properties):
        OwnChannel.__init__(self, flow, name, properties)
        self._uploads = []

    def upload(self, path, data, then=None):
        """Puts bytes there as a file. An upload that the loss of the hub interrupted goes on where it stopped. Answers the
        `Upload`."""
        return self._begin(Upload(self, path, as_bytes(data), None, then))

    def upload_file(self, path, file, then=None):
        """As `upload`, a file of this machine: its name. It is read a piece at a time."""
        return self._begin(Upload(self, path, None, file, then))

    def _begin(self, upload):
        self._uploads.append(upload)
        if self.opened:
            upload.begin()
        return upload

    def mkdir(self, path, then=None):
        """Makes a directory; the one above must be there."""
        self._change(then, path, "blob_mkdir", path)

    def move(self, path, to, then=None):
        """Moves a file or a directory, in place of a file that is there."""
        self._change(then, path, "blob_move", path, to)

    def remove_file(self, path, then=None):
        """Removes a file or an empty directory."""
        self._change(then, path, "blob_remove", path)

    def _change(self, then, path, command, *values):
        self.flow.ask(self.outcome(then), command, self.reference or (0, 0), *values, about=path)

    def outcome(self, then):
        """What takes the answer of a command and calls `then(error)`."""
        def told(answer):
            error = answer if isinstance(answer, Refused) else None
            if then is not None:
                then(error)
            elif error is not None:
                self.flow.listener.on_refused(error)
        return told

    def exists(self, channel):
        OwnChannel.exists(self, channel)
        for upload in list(self._uploads):
            upload.begin()

    def over(self, upload):
        """For an upload: it is."""
        if upload in self._uploads:
            self._uploads.remove(upload)


class Upload(object):
    """A file on its way to the hub: `sent` of `size` bytes."""

    def __init__(self, store, path, data, file, then):
        self._store, self.path, self._then = store, path, store.outcome(then)
        self._data, self._file = data, file
        self.sent, self.done = 0, False
        self.size, self._checksum = self._measure()

    def _measure(self):
        if self._file is None:
            return len(self._data), zlib.crc32(self._data) & 0xffffffff
        checksum = 0
        with open(self._file, "rb") as file:
            for piece in iter(lambda: file.read(PIECE_BYTES), b""):
                checksum = zlib.crc32(piece, checksum)
        return os.path.getsize(self._file), checksum & 0xffffffff

    def cancel(self):
        """Gives it up; the hub forgets what was sent."""
        self._give_up("the upload was given up")

    def _give_up(self, why):
        if not self.done and self._store.opened:
            self._store.flow.command("blob_abort", self._store.reference, self.path, about=self.path)
        self._end(Refused("Aborted", why, self.path))

    def begin(self):
        """For the store: asks the hub where to go on."""
        self._ask(self._go_on, "blob_begin", self.path, self.size, self._checksum)

    def _go_on(self, answer):
        if answer[0] == "blob_resume":
            self.sent = answer[1][0]
        if self.sent >= self.size:
            return self._ask(lambda _: self._end(None), "blob_commit", self.path)
        try:
            piece, at = self._piece(), self.sent
        except (IOError, OSError) as error:
            return self._give_up("it cannot be read any more: %s" % error)
        self.sent += len(piece)
        store = self._store
        store.flow.ask_message(self._unless_refused(self._go_on), "blob_write", (store.reference, self.path, at), piece,
                               about=self.path)

    def _piece(self):
        if self._file is None:
            return self._data[self.sent:self.sent + PIECE_BYTES]
        with open(self._file, "rb") as file:
            file.seek(self.sent)
            # What was added since it was measured is no part of it.
            piece = file.read(min(PIECE_BYTES, self.size - self.sent))
        if not piece:
            raise IOError("%s has become shorter" % self._file)
        return piece

    def _ask(self, then, command, *values):
        self._store.flow.ask(self._unless_refused(then), command, self._store.reference, *values, about=self.path)

    def _unless_refused(self, then):
        def told(answer):
            if self.done:
                return
            if not isinstance(answer, Refused):
                return then(answer)
            if answer.code not in ("Lost", "Gone"):
                self._end(answer)
        return told

    def _end(self, error):
        if not self.done:
            self.done = True
            self._store.over(self)
            self._then(error if error is not None else ("saved", []))


class Files(object):
    """The files of somebody's blob channel, as a satellite reads them. Each `then(result, error)` is called once."""

    def __init__(self, flow, name):
        self._flow, self.name = flow, name

    def list(self, path, then):
        """The entries of a directory, `""` for the channel's own: a list of `FileInfo`."""
        found = []

        def told(answer):
            if isinstance(answer, Refused):
                return then(None, answer)
            if answer[0] == "list_end":
                return then(found, None)
            found.append(FileInfo(*answer[1]))
        self._ask(told, then, "blob_list", path)

    def stat(self, path, then):
        """One entry: a `FileInfo`."""
        def told(answer):
            if isinstance(answer, Refused):
                return then(None, answer)
            directory, size, checksum = answer[1]
            then(FileInfo(path, directory, size, checksum), None)
        self._ask(told, then, "blob_stat", path)

    def read(self, path, then):
        """A whole file: bytes, checked against the hub's checksum."""
        pieces = []

        def stated(info, error):
            if error is not None:
                return then(None, error)
            ask(info)

        def ask(info):
            at = sum(len(piece) for piece in pieces)
            if at >= info.bytes:
                return then(*checked(path, b"".join(pieces), info))
            self._ask(lambda answer: told(answer, info), then, "blob_read", path, at, PIECE_BYTES)

        def told(answer, info):
            if isinstance(answer, Refused):
                return then(None, answer)
            pieces.append(answer[1][0])
            if not pieces[-1]:
                return then(None, changed(path))
            ask(info)
        self.stat(path, stated)

    def _ask(self, told, then, command, *values):
        channel = self._flow.channels.named(self.name, "blob")
        if channel is None:
            return then(None, Refused("Gone", "there is no blob channel %s" % self.name, self.name))
        self._flow.ask(told, command, channel.reference, *values, about=values[0])


def changed(path):
    """The refusal for a file that became another one while it was read."""
    return Refused("BadChecksum", "the file was changed while it was read", path)


def checked(path, data, info):
    """(data, None) if the file is what the hub said, else (None, refusal)."""
    if len(data) != info.bytes or zlib.crc32(data) & 0xffffffff != info.checksum:
        return None, changed(path)
    return data, None
