"""Makes and reads data sets: labelled sequences in the layouts that training code reads.

    data = evis.dataset.open("disks")                     the sequences of a data set, or of one folder
    windows = data.windows(seconds=0.05, ...)             events cut into windows, as images, with labels
    live = evis.dataset.stream("rotation", ...)           the same, simulated while it is gone over
    evis.dataset.collate, evis.dataset.Augment            batches of what is ragged; changes drawn for each window

docs/loading.md is the tour. What stands here is imported when it is first used.
"""

from importlib import import_module

TYPE_CHECKING = False
"""As typing's; type checkers and editors go by the name."""
if TYPE_CHECKING:
    from evis.dataset.augmenting.augmentation import Augment as Augment
    from evis.dataset.loading.collate import collate as collate
    from evis.dataset.loading.sequences import open_dataset as open
    from evis.dataset.streaming.stream import stream as stream

__all__ = ["Augment", "collate", "open", "stream"]
_LAZY = {
    "Augment": "evis.dataset.augmenting.augmentation:Augment",
    "collate": "evis.dataset.loading.collate:collate",
    "open": "evis.dataset.loading.sequences:open_dataset",
    "stream": "evis.dataset.streaming.stream:stream",
}
"""Public name -> module:attribute."""

if not TYPE_CHECKING:  # who checks types shall not take any name for granted

    def __getattr__(name: str) -> object:
        """Imports a public name at its first use (PEP 562). Raises AttributeError."""
        if name not in _LAZY:
            raise AttributeError(f"module 'evis.dataset' has no attribute '{name}'; it has {', '.join(__all__)}")
        module, _, attribute = _LAZY[name].partition(":")
        value = getattr(import_module(module), attribute)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """Lists the public names, imported or not."""
    return sorted({*globals(), *__all__})
