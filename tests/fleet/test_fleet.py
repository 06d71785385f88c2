"""Fleets: the laws behind them, and what their files hold."""

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from faultgen.cli.app import app
from faultgen.dataset.experiment import Experiment
from faultgen.dataset.sweep import generate
from faultgen.effects import Applied, set_temperature
from faultgen.errors import InputError
from faultgen.fleet import FleetPlan, generate_fleet, open_fleet
from faultgen.fleet.calendar import HALL_DAY, HALL_DAYS, ROWS, STEP, draw_calendar
from faultgen.fleet.cycles import (
    DAMAGES,
    SAMPLE_PERIOD,
    TEMPERATURES,
    program_motion,
    simulate_program,
)
from faultgen.fleet.damage import GearboxLife
from faultgen.fleet.events import Strain, count_events, event_names
from faultgen.fleet.plan import parse_fleet
from faultgen.fleet.record import record_robot, simulate_robot
from faultgen.fleet.robot_instance import draw_instance
from faultgen.fleet.thermal import TIME_CONSTANT, temperatures
from faultgen.monitoring.reductions import LIFE_EXPONENT
from faultgen.simulation.plant import assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate

MOST = 20.0  # events of a kind of an axis that a robot stores on a day

SMALL = {
    "robots": 2,
    "failing": 1,
    "days": 3,
    "models": ["puma560"],
    "programs": {"tasks": ["pick_and_place"], "number": [1, 1], "speed": [0.9, 1.0]},
    "production": {"samples_a_day": [2, 2]},
}


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    return generate_fleet(FleetPlan(**SMALL), tmp_path_factory.mktemp("fleet"), workers=2)


@pytest.fixture(scope="module")
def failing():
    plan = FleetPlan(**SMALL)
    instance = next(
        instance for instance in (draw_instance(plan, k) for k in range(2)) if instance.fails
    )
    return instance, simulate_program(instance, instance.programs[0])


def life(**other):
    told = {"axis": 2, "failure": 100.0, "life": 80.0, "shape": 3.0, "unsteadiness": 0.3}
    return GearboxLife(**(told | {"friction": 0.5, "backlash": 1e-3, "ripple": 0.1} | other))


def test_damage_ends_at_one_and_begins_a_life_before():
    one = life()
    assert one.damage([0.0, 20.0, 100.0]) == pytest.approx([0.0, 0.0, 1.0])
    assert one.damage([60.0]) == pytest.approx((np.exp(1.5) - 1) / (np.exp(3) - 1))


def test_what_shows_of_damage_is_right_on_average():
    shown = life().shown(20000, np.random.default_rng(1))
    assert shown.mean() == pytest.approx(1.0, abs=0.01)
    assert np.log(shown).std() == pytest.approx(0.3, rel=0.03)
    steady = life(unsteadiness=0.0).shown(5, np.random.default_rng(1))
    assert steady == pytest.approx(1.0)


def test_gearboxes_of_healthy_robots_age_slowly():
    """Their life is 40 000 h of operation; the share of it that is over at the end is drawn."""
    plan = FleetPlan(seed=3, robots=60, failing=20)
    instances = [draw_instance(plan, k) for k in range(60)]
    assert sum(instance.fails for instance in instances) == 20
    ages = []
    for instance in instances:
        start, end = instance.life.damage([0.0, 60.0])
        if instance.fails:
            assert instance.life.failure == 60 and end == 1
            assert 120 <= instance.life.life <= 600
            continue
        hours = instance.life.life * instance.hours_a_day
        assert hours == pytest.approx(40_000)
        ages.append(1 - (instance.life.failure - 60) / instance.life.life)
        assert 0 <= start <= end < 0.7
        # 60 days are at most 60 * 22.5 h of the 40 000 h
        assert end - start <= instance.life.shape * 60 * 22.5 / 40_000 * (end + 0.2)
    assert 0 <= min(ages) < 0.1 and 0.7 < max(ages) <= 0.8
    assert np.mean(ages) == pytest.approx(0.4, abs=0.11)  # three standard errors


def test_healthy_robots_need_not_age():
    """Ageing can be left out; robots that fail are the same with and without it."""
    plan, steady = (FleetPlan(seed=3, robots=8, failing=4, ageing=a) for a in ({}, {"hours": 0}))
    for number in range(8):
        one, other = draw_instance(plan, number), draw_instance(steady, number)
        assert one.fails == other.fails
        assert other.life == (one.life if one.fails else None)
        assert one.payload == other.payload and one.shifts == other.shifts


def test_hours_a_day_are_those_of_the_calendar():
    """A instance's mean time of operation is what its calendar gives over many weeks."""
    plan = FleetPlan(days=700, robots=3, failing=0)
    for number in range(3):
        instance = draw_instance(plan, number)
        calendar = draw_calendar(plan, instance, 6, np.random.default_rng(number))
        hours = calendar.duty.sum() * STEP / plan.days
        assert hours == pytest.approx(instance.hours_a_day, rel=0.02)


def test_effects_grow_with_damage():
    friction, backlash, ripple = life().effects(0.5)
    assert (friction.severity, backlash.severity, ripple.severity) == (0.25, 0.5e-3, 0.05)
    assert all(one.axis == 2 for one in (friction, backlash, ripple))


def test_constant_loss_warms_exponentially():
    """Closed form of one thermal mass: T = ambient + duty P R (1 - exp(-t / RC))."""
    rows = 400
    loss = np.full((rows, 2, 1), 50.0)
    out = temperatures(
        np.full(rows, 20.0), np.full(rows, 0.8), loss, np.array([30.0, 80.0]), np.array([0.5]), 0.1
    )
    time = 0.1 * np.arange(rows)
    assert out[:, 0] == pytest.approx(20 + 0.8 * 50 * 0.5 * (1 - np.exp(-time / TIME_CONSTANT)))


def test_loss_that_falls_with_temperature_settles_where_heat_is_lost():
    """At rest P(T) R = T - ambient; P falls from 100 W at 30 to 0 W at 80 deg C."""
    loss = np.tile(np.array([[100.0], [0.0]]), (4000, 1, 1))
    out = temperatures(
        np.full(4000, 20.0), np.ones(4000), loss, np.array([30.0, 80.0]), np.array([0.5]), 0.1
    )
    settled = (20 + 0.5 * 160) / (1 + 0.5 * 2)  # T = 20 + 0.5 (160 - 2 T)
    assert out[-1, 0] == pytest.approx(settled)


def test_gearboxes_settle_where_the_table_of_losses_says():
    """At rest T = ambient + R P(T); P is on a line between its nodes, and constant beyond them."""
    nodes = np.array([30.0, 45.0, 60.0, 80.0])
    loss = np.array([[90.0, 80.0], [60.0, 75.0], [50.0, 20.0], [10.0, 15.0]])
    resistance = np.array([0.3, 0.5])
    reached = []
    for ambient in (-20.0, 0.0, 10.0, 25.0, 40.0, 75.0):
        rows = np.full(600, ambient)
        many = np.tile(loss, (600, 1, 1))
        settled = temperatures(rows, np.ones(600), many, nodes, resistance, 0.1)[-1]
        heat = [np.interp(settled[axis], nodes, loss[:, axis]) for axis in (0, 1)]
        assert settled == pytest.approx(ambient + resistance * heat, abs=1e-6)
        reached.extend(np.searchsorted(nodes, settled).tolist())
    assert set(reached) == {0, 1, 2, 3, 4}  # below, in each part, and above


def direct(instance, temperature, payload, friction, damage):
    """A cycle at a condition, simulated as such."""
    robot = instance.robot()
    spec = robot.spec()
    for axis, warm in enumerate(temperature, start=1):
        set_temperature(spec, axis, float(warm), robot.friction_temperature)
    spec.body("payload").mass *= 1 + payload
    spec.body("payload").inertia *= 1 + payload
    more = [Applied("friction_wear", k + 1, float(f)) for k, f in enumerate(friction)]
    worn = instance.life.effects(damage)
    plant = assemble(robot, [*instance.deviations, *more, *worn], spec=spec)
    control = control_signal(program_motion(robot, instance.programs[0]), robot.model.opt.timestep)
    (cycle,) = simulate(robot, control, [plant], sample_period=SAMPLE_PERIOD)
    return cycle


def test_cycles_are_exact_where_simulated(failing):
    instance, cycles = failing
    warm = np.full(6, TEMPERATURES[1])
    got = cycles.at(warm, 0.0, np.zeros(6), DAMAGES[1])[0]
    assert got == pytest.approx(
        direct(instance, warm, 0.0, np.zeros(6), DAMAGES[1]).motor_torque, abs=1e-12
    )
    healthy = cycles.at(np.full(6, TEMPERATURES[3]), 0.0, np.zeros(6), 0.0)
    assert healthy == pytest.approx(cycles.base[3], abs=1e-12)


def test_cycles_in_between_are_near_to_simulation(failing):
    """What is left out is second order: below the torque noise of a fleet."""
    instance, cycles = failing
    warm = np.array([36.0, 44.0, 50.0, 56.0, 48.0, 40.0])
    friction = np.array([0.05, -0.03, 0.04, 0.0, 0.08, -0.05])
    want = direct(instance, warm, 0.04, friction, 0.7).motor_torque
    got = cycles.at(warm, 0.04, friction, 0.7)[0]
    error = np.sqrt(np.mean((want - got) ** 2, axis=0))
    assert np.all(error < FleetPlan().torque_noise * np.abs(want).mean(axis=0))


def test_damage_heats_its_gearbox(failing):
    """Heat between nodes of damage, against direct simulation; other axes get none."""
    instance, cycles = failing
    warm, axis = TEMPERATURES[1], instance.life.axis - 1
    cycle = direct(instance, np.full(6, warm), 0.0, np.zeros(6), 0.7)
    want = np.abs(cycle.friction_torque * cycle.motor_velocity).mean(axis=0)
    sound, got = cycles.losses(np.array([0.0, 0.7]))[:, 1]
    assert sound == pytest.approx(cycles.loss[1], abs=0)
    assert got[axis] == pytest.approx(want[axis], rel=1e-3)
    assert got[axis] > 1.1 * sound[axis]
    assert np.delete(got, axis) == pytest.approx(np.delete(sound, axis), abs=0)


def test_duty_and_mix(failing):
    instance, _ = failing
    plan = FleetPlan(**SMALL | {"days": 140})
    calendar = draw_calendar(plan, instance, 6, np.random.default_rng(3))
    assert calendar.mix.sum(axis=1) == pytest.approx(1.0)
    duty = calendar.duty.reshape(-1, ROWS)
    running = (duty > 0).sum(axis=1) * STEP
    assert running == pytest.approx(instance.shifts * 7.5, abs=0.2)  # half an hour of break a shift
    weekday = np.mod(instance.first_weekday + np.arange(140), 7)
    level = duty.max(axis=1)
    assert level[weekday < 5].mean() == pytest.approx(instance.duty, rel=0.05)
    assert level[weekday >= 5].mean() == pytest.approx(instance.duty * instance.weekend, rel=0.1)


@pytest.mark.parametrize(("shifts", "first"), [(1, 6.0), (2, 6.0), (3, 0.0)])
def test_shifts_begin_at_their_hour(shifts, first):
    """One and two shifts begin at six; three fill the day. The break is after four hours."""
    plan = FleetPlan(**SMALL)
    unit = replace(draw_instance(plan, 0), shifts=shifts)
    duty = draw_calendar(plan, unit, 6, np.random.default_rng(3)).duty.reshape(-1, ROWS)
    assert np.flatnonzero(duty[0])[0] * STEP == pytest.approx(first)
    still = np.flatnonzero(duty[0][round(first / STEP) :] == 0)[0] * STEP
    assert still == pytest.approx(4.0)


def test_a_calendar_varies_as_it_says():
    """The hall over the day and from day to day, the parts, and the shares of the programs."""
    many = {"number": [3, 3], "change": 30.0, "mix": 1e6}
    plan = FleetPlan(**SMALL | {"days": 2000, "programs": SMALL["programs"] | many})
    unit = draw_instance(plan, 0)
    calendar = draw_calendar(plan, unit, 6, np.random.default_rng(5))
    by_day = calendar.ambient.reshape(-1, ROWS)
    course = by_day.mean(axis=0)
    hour = np.arange(ROWS) * STEP
    warmest = np.cos(2 * np.pi * (hour - 15.6) / 24)  # at 15:36
    assert course - course.mean() == pytest.approx(HALL_DAY * warmest, abs=0.05)
    noon = by_day[:, ROWS // 2]
    assert noon.std() == pytest.approx(HALL_DAYS, rel=0.15)
    assert np.corrcoef(noon[1:], noon[:-1])[0, 1] == pytest.approx(0.8, abs=0.05)
    parts = calendar.payload / plan.programs.parts
    assert parts.std() == pytest.approx(1.0, rel=0.05)
    for largest in (-parts.min(), parts.max()):
        assert 2.5 < largest < 3.0 + 1e-9
    moved = np.abs(np.diff(calendar.mix, axis=0)).max(axis=1) > 0.02
    assert set(np.flatnonzero(moved) + 1) <= set(calendar.changes)
    assert moved.sum() > 0.9 * np.sum(calendar.changes > 0)
    assert len(calendar.changes) == pytest.approx(2000 / 30, rel=0.4)


def test_robots_of_a_fleet_differ_within_their_limits():
    """Every number of programs, shifts and samples occurs; friction is 0.4 to 3 times nominal."""
    scatter = {"coulomb": 0.15, "viscous": 1.5}
    plan = FleetPlan(robots=60, failing=0, programs={"number": [2, 4]}, scatter=scatter)
    units = [draw_instance(plan, k) for k in range(60)]
    assert {len(unit.programs) for unit in units} == {2, 3, 4}
    assert {unit.shifts for unit in units} == {1, 2, 3}
    assert {unit.samples_a_day for unit in units} == {1, 2, 3, 4}
    sizes = {
        name: np.array(
            [one.severity for unit in units for one in unit.deviations if one.effect == name]
        )
        for name in ("coulomb_friction", "viscous_friction")
    }
    assert sizes["coulomb_friction"].std() == pytest.approx(0.15, rel=0.15)
    assert sizes["coulomb_friction"].mean() == pytest.approx(0.0, abs=0.03)
    assert sizes["viscous_friction"].min() == -0.6
    assert sizes["viscous_friction"].max() == 2.0


def strain(deviation):
    ones = np.ones(6)
    return Strain(ones, deviation * ones, 1e-3 * ones, 40 * ones, 25.0, 1000.0)


def test_events_are_named_and_of_their_number():
    """A six-axis robot has as many kinds of events as the log in the thesis."""
    names = event_names()
    assert len(names) == len(set(names)) == 67


def test_rule_based_events_follow_the_rule(failing):
    """Deviation at the limit: every second cycle, less what operators put up with."""
    instance, _ = failing
    plan = FleetPlan(**SMALL | {"days": 400})
    calendar = draw_calendar(plan, instance, 6, np.random.default_rng(3))
    days = [strain(0.1)] * 200 + [strain(0.16)] * 200
    counts = count_events(instance.robot(), days, calendar, np.random.default_rng(4))
    column = event_names().index("motion_supervision_4")
    assert counts[200:, column].mean() == pytest.approx(MOST * (1 - np.exp(-500 / MOST)), rel=0.1)
    assert counts[:200, column].mean() < 2.0
    stops = counts[:, event_names().index("program_stopped")]
    assert stops[200:].mean() > stops[:200].mean() + 5 * 0.9 * MOST


def test_services_and_changes_are_logged_once(failing):
    """Besides what happens anyway, each adds one event to its day, and none to any other."""
    unit, _ = failing
    plan = FleetPlan(**SMALL | {"days": 400})
    calendar = draw_calendar(plan, unit, 6, np.random.default_rng(3))
    days = np.arange(400)
    none = np.zeros(0, int)
    logged = {"service_done": calendar.services, "program_changed": calendar.changes}
    without = replace(calendar, services=none, changes=none)
    counts, before = (
        count_events(unit.robot(), [strain(0.1)] * 400, one, np.random.default_rng(4))
        for one in (calendar, without)
    )
    for name, column in zip(event_names(), (counts - before).T, strict=True):
        assert np.array_equal(column, np.isin(days, logged.get(name, none))), name
    assert len(calendar.services) and len(calendar.changes)


def test_motors_get_hot_half_as_often_as_their_gearboxes(failing):
    """Events that follow another kind of the same axis: half, and three tenths as many."""
    instance, _ = failing
    plan = FleetPlan(**SMALL | {"days": 600})
    calendar = draw_calendar(plan, instance, 6, np.random.default_rng(3))
    usual = [strain(0.1)] * 100
    hot = [replace(strain(0.1), temperature=np.full(6, 46.0), position_error=np.full(6, 1.3e-3))]
    counts = count_events(instance.robot(), usual + hot * 500, calendar, np.random.default_rng(4))

    def mean(kind):
        columns = [event_names().index(f"{kind}_{axis}") for axis in range(1, 7)]
        return counts[100:, columns].mean() - counts[:100, columns].mean()

    # the usual 40 deg C and the margin of 6 K: every second of 24 hours, less what is put up with
    assert mean("gearbox_temperature") == pytest.approx(MOST * (1 - np.exp(-12 / MOST)), rel=0.03)
    assert mean("motor_temperature") == pytest.approx(0.5 * mean("gearbox_temperature"), rel=0.05)
    assert mean("position_deviation") > 10
    assert mean("speed_deviation") == pytest.approx(0.3 * mean("position_deviation"), rel=0.05)


def test_a_fleet_holds_what_monitoring_stores(fleet):
    assert [one.failed for one in fleet.robots].count(True) == 1
    assert tuple(fleet.event_names) == event_names()
    for one in fleet.robots:
        samples = len(one.day)
        assert 3 <= samples <= 6 and np.all(np.diff(one.day) > 0) and one.day[-1] <= 3
        for name in ("torque", "speed", "angle"):
            shares = getattr(one, f"{name}_histogram")
            assert shares.shape == (samples, 6, 12)
            assert shares.sum(axis=2) == pytest.approx(1.0)
        assert one.events.shape == (3, 67)
        assert one.failed == (one.axis > 0) == bool(one.truth["damage"][-1] > 0.9)
        left = one.truth["remaining_life"]
        assert np.diff(left) == pytest.approx(-np.diff(one.day))
        assert (left[-1] == pytest.approx(3 - one.day[-1])) == one.failed
        assert one.truth["damaged_axis"][0] == one.axis if one.failed else one.axis == 0
        # speed of production, whatever its share, is that of the programs
        speed = one.speed_indicator / one.production[:, None]
        assert np.ptp(speed, axis=0) == pytest.approx(0.0, abs=1e-9)
        torque = one.torque_indicator / one.production[:, None] ** (1 / LIFE_EXPONENT)
        assert np.ptp(torque, axis=0) / torque.mean(axis=0) == pytest.approx(0.0, abs=0.3)


@pytest.mark.slow
def test_cycles_serve_plans_that_differ_in_what_befalls_robots(failing):
    """Records from another plan's cycles are those that the plan itself gives."""
    plan, other = (
        FleetPlan(**SMALL | {"damage": {"unsteadiness": k}, "programs": SMALL["programs"] | mix})
        for k, mix in ((0.0, {}), (1.0, {"mix": 20.0}))
    )
    number = next(k for k in range(2) if draw_instance(plan, k).fails)
    cycles = simulate_robot(plan, number)
    given, own = record_robot(other, number, cycles), record_robot(other, number)
    assert np.array_equal(given.torque_histogram, own.torque_histogram)
    assert np.array_equal(given.events, own.events)
    steady = record_robot(plan, number, cycles)
    assert not np.array_equal(given.torque_indicator, steady.torque_indicator)


@pytest.mark.slow
def test_one_seed_is_one_fleet(fleet, tmp_path):
    again = generate_fleet(FleetPlan(**SMALL), tmp_path, workers=1)
    files = sorted((tmp_path / "robots").iterdir())
    before = [one.stat().st_mtime_ns for one in files]
    for one, other in zip(fleet.robots, again.robots, strict=True):
        assert np.array_equal(one.torque_histogram, other.torque_histogram)
        assert np.array_equal(one.events, other.events)
        assert np.array_equal(one.truth["gearbox_temperature"], other.truth["gearbox_temperature"])
    files[0].write_bytes(b"half")
    generate_fleet(FleetPlan(**SMALL), tmp_path)
    after = [one.stat().st_mtime_ns for one in files]
    assert after[0] != before[0] and after[1:] == before[1:]
    with pytest.raises(InputError, match="another plan"):
        generate_fleet(FleetPlan(**SMALL | {"seed": 5}), tmp_path)
    with pytest.raises(InputError, match="holds a fleet"):
        generate(Experiment(robot=["puma560"], task=["spot_weld"], cycles=2), tmp_path)
    (tmp_path / "dataset").mkdir()
    (tmp_path / "dataset" / "runs.json").write_text("{}")
    with pytest.raises(InputError, match="holds a dataset"):
        generate_fleet(FleetPlan(**SMALL), tmp_path / "dataset")
    files[1].unlink()
    with pytest.raises(InputError, match="1 of 2 robots"):
        open_fleet(tmp_path)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("robots = 0", "robots"),
        ("failing = 30", "failing: must be at most the number of robots, which is 26, not 30"),
        ('models = ["kuka"]', "models: unknown 'kuka'"),
        ("[damage]\nlife = [3, 2]", "damage.life"),
        ("[damage]\nrust = 2", "damage.rust"),
        ('[programs]\ntasks = ["paint"]', "irb6700 has no 'paint'"),
        ("[production]\nshifts = [1, 4]", "production.shifts: a day has at most 3 shifts"),
        ("robots = ", "not valid TOML"),
    ],
)
def test_bad_plans_are_told_in_one_line(text, told, tmp_path):
    with pytest.raises(InputError) as caught:
        parse_fleet(text, "fleet.toml")
    assert told in str(caught.value) and "\n" not in str(caught.value)


def test_command(tmp_path):
    plan = tmp_path / "fleet.toml"
    plan.write_text(
        'robots = 1\nfailing = 0\ndays = 2\nmodels = ["puma560"]\n'
        '[programs]\ntasks = ["pick_and_place"]\nnumber = [1, 1]\n'
    )
    done = CliRunner().invoke(app, ["fleet", str(plan), "-o", str(tmp_path / "out"), "--json"])
    assert done.exit_code == 0, done.output
    assert '"name": "robot001"' in done.output
    assert open_fleet(tmp_path / "out").days == 2
