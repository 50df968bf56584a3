"""A link: `dump:PATH` appends all that is written to a file, and reads nothing."""

from __future__ import annotations

from arva_hil import Address, AddressError, Link, LinkError, Opening


class DumpLink(Link):
    """Remembers the file."""

    def __init__(self, path: str) -> None:
        self.name = f"dump:{path}"
        try:
            self._file = open(path, "ab", buffering=0)  # noqa: SIM115
        except OSError as error:
            raise LinkError(self.name, f"cannot be written: {error.strerror}") from error

    @classmethod
    def open(cls, address: Address, how: Opening) -> DumpLink:
        if not address.path:
            raise AddressError("'dump:' has no path: write dump:/tmp/frames")
        return cls(address.path)

    def read(self) -> bytes:
        return b""

    def write(self, data: bytes) -> bool:
        self._file.write(data)
        return True

    def close(self) -> None:
        self._file.close()
