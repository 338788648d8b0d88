"""The clock of a run, on a time of our own."""

from stickslip.solvers.parallel.counters import Clock, Counters, Row


class Hands:
    """A time and a number of volume solves that a test moves."""

    def __init__(self) -> None:
        self.time, self.solves = 100.0, 7

    def pass_on(self, seconds: float, solves: int = 0) -> None:
        self.time, self.solves = self.time + seconds, self.solves + solves

    def clock(self) -> Clock:
        return Clock(lambda: self.solves, lambda: self.time)


def spent(clock: Clock) -> dict[tuple[str, str], tuple[float, int, int]]:
    return {(row.phase, row.part): (row.seconds, row.calls, row.volume_solves) for row in clock.rows()}


def test_a_phase_within_another_one_counts_once() -> None:
    hands = Hands()
    clock = hands.clock()
    hands.pass_on(1.0)
    with clock.phase("iterate"):
        hands.pass_on(2.0, 3)
        with clock.phase("error"):
            hands.pass_on(4.0, 5)
            with clock.part("stress"):
                hands.pass_on(8.0)
        hands.pass_on(16.0, 1)
    assert spent(clock) == {
        ("iterate", ""): (18.0, 1, 4),
        ("error", ""): (4.0, 1, 5),
        ("error", "stress"): (8.0, 1, 0),
        ("other", ""): (1.0, 0, 0),
    }
    assert clock.seconds("error") == 12.0


def test_a_phase_that_fails_has_its_seconds_and_gives_the_clock_back() -> None:
    hands = Hands()
    clock = hands.clock()
    try:
        with clock.phase("iterate"):
            hands.pass_on(2.0)
            raise ArithmeticError
    except ArithmeticError:
        hands.pass_on(3.0)
    assert spent(clock) == {("iterate", ""): (2.0, 1, 0), ("other", ""): (3.0, 0, 0)}


def test_rows_are_true_within_a_phase() -> None:
    hands = Hands()
    clock = hands.clock()
    with clock.phase("output"):
        hands.pass_on(2.0)
        assert clock.seconds("output") == 2.0
        hands.pass_on(2.0)
    assert clock.seconds("output") == 4.0


def test_what_an_earlier_process_spent_is_added() -> None:
    hands = Hands()
    clock = hands.clock()
    with clock.phase("mesh"):
        hands.pass_on(1.0)
    clock.add([Row(phase=name, part="", seconds=2.0, calls=3, volume_solves=4) for name in ("mesh", "audit")])
    assert spent(clock) == {("mesh", ""): (3.0, 4, 4), ("audit", ""): (2.0, 3, 4), ("other", ""): (0.0, 0, 0)}


def test_solves_of_an_earlier_process_belong_to_no_phase_of_this_one() -> None:
    counters = Counters()
    with counters.clock.phase("prepare"):
        counters.add(Counters(volume_solves=5, error_solves=6))
        counters.volume_solves += 1
    assert [row.volume_solves for row in counters.clock.rows() if row.phase == "prepare"] == [1]


def test_solves_for_errors_count_in_their_phase() -> None:
    counters = Counters()
    with counters.clock.phase("error"), counters.for_error():
        counters.volume_solves += 2
    assert (counters.volume_solves, counters.error_solves) == (0, 2)
    assert [row.volume_solves for row in counters.clock.rows() if row.phase == "error"] == [2]
