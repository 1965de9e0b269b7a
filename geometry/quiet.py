"""The CAD kernel kept off standard output, where a caller may be printing JSON."""

from __future__ import annotations


def silence_kernel() -> None:
    """Remove every printer of the kernel's default messenger; its faults still come back as return values."""
    from OCP.Message import Message

    messenger = Message.DefaultMessenger_s()
    while messenger.Printers().Size():
        messenger.RemovePrinters(messenger.Printers().First().DynamicType())
