"""A polled instrument in memory: a clock that jumps, a wire to a device, a chamber that obeys at once."""

from drivers.errors import DeviceSilent


class Clock:
    def __init__(self):
        self.time_s = 0.0

    def now(self):
        return self.time_s

    def sleep(self, duration_s):
        self.time_s += duration_s


class Wire:
    """What the driver needs of a Link; `answer(data, now_s)` is the device, a list of (time in s, bytes)."""

    def __init__(self, answer):
        self.answer = answer
        self.clock = Clock()
        self.name, self.url = "chamber", "memory"
        self.sent, self.exchanges = b"", []
        self.pending, self.buffer = [], b""

    def write(self, data):
        self.sent += data
        self.exchanges.append((round(self.clock.now() * 1e9), "sent", data))
        self.pending += self.answer(data, self.clock.now())

    def _arrive(self, until_s):
        while self.pending and self.pending[0][0] <= until_s:
            at_s, data = self.pending.pop(0)
            self.buffer += data
            self.exchanges.append((round(at_s * 1e9), "received", data))

    def discard(self):
        self._arrive(self.clock.now())
        stale, self.buffer = self.buffer, b""
        return stale

    def _await(self, complete, deadline_s):
        """Let time pass until `complete()` or the deadline; return whether it is."""
        self._arrive(self.clock.now())
        while not complete():
            if not self.pending or self.pending[0][0] > deadline_s:
                self.clock.time_s = max(self.clock.time_s, deadline_s)
                return False
            self.clock.time_s = max(self.clock.time_s, self.pending[0][0])
            self._arrive(self.clock.now())
        return True

    def read_until(self, terminator, timeout_s):
        if not self._await(lambda: terminator in self.buffer, self.clock.now() + timeout_s):
            raise DeviceSilent("silent", found=repr(self.buffer))
        end = self.buffer.index(terminator) + len(terminator)
        data, self.buffer = self.buffer[:end], self.buffer[end:]
        return data

    def read_some(self, timeout_s):
        self._await(lambda: self.buffer, self.clock.now() + timeout_s)
        return self.discard()


class Plant:
    """A chamber that reaches every set point at once while it runs."""

    def __init__(self):
        self.demands = []
        self.set_point = 23.0
        self.air = 21.98765

    def demand(self, now_s, *, set_point_c, ramp_up, ramp_down, running):
        self.demands.append((set_point_c, ramp_up, ramp_down, running))
        self.set_point = set_point_c
        self.air = set_point_c if running else self.air

    def air_temp_c(self, now_s):
        return self.air

    def set_point_c(self, now_s):
        return self.set_point

    def auxiliary_c(self, number, now_s):
        return 10.0 * number + 0.1234
