"""Windows of the logged signals as a dataset of PyTorch."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from faultgen.dataset.windows import Windows


class TorchWindows(torch.utils.data.Dataset):
    """A map-style dataset whose items are read from the files by the process that asks for them."""

    def __init__(self, windows: Windows) -> None:
        """Wrap windows.

        Args:
            windows: The windows.
        """
        self.windows = windows

    def __len__(self) -> int:
        """Number of windows."""
        return len(self.windows)

    def __getitem__(self, index: int) -> Any:
        """Read a window as a tensor of shape (window, channels), and its label as a scalar."""
        item = self.windows[index]
        if self.windows.labels is None:
            return torch.from_numpy(item)
        return torch.from_numpy(item[0]), torch.as_tensor(item[1])

    @property
    def classes(self) -> tuple[str, ...]:
        """As `Windows.classes`."""
        return self.windows.classes

    @property
    def channels(self) -> tuple[str, ...]:
        """As `Windows.channels`."""
        return self.windows.channels

    @property
    def y(self) -> np.ndarray:
        """Label of each window, shape (windows,)."""
        return self.windows.y

    @property
    def groups(self) -> np.ndarray:
        """Group of each window, shape (windows,)."""
        return self.windows.groups
