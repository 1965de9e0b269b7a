"""STM32F446 firmware and the Python that builds, tests and emulates it."""
