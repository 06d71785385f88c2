"""What a fleet's monitoring stores of a robot: of cycles that are written down, not simulated."""

from dataclasses import replace

import numpy as np
import pytest

from faultgen.errors import InputError
from faultgen.fleet import FleetPlan
from faultgen.fleet import cycles as cycles_module
from faultgen.fleet import record as module
from faultgen.fleet.calendar import ROWS, Calendar, draw_calendar
from faultgen.fleet.cycles import DAMAGES, TEMPERATURES, Cycles, program_motion
from faultgen.fleet.events import AXIS_EVENTS, Strain, count_events, event_names
from faultgen.fleet.record import record_robot
from faultgen.fleet.robot_instance import draw_instance
from faultgen.fleet.thermal import RISE
from faultgen.monitoring.reductions import LIFE_EXPONENT, histogram

DAYS = 3
PLAN = FleetPlan(
    robots=2,
    failing=1,
    days=DAYS,
    models=["puma560"],
    programs={"tasks": ["pick_and_place"], "number": [2, 2]},
    production={"samples_a_day": [2, 2]},
    torque_noise=0.0,
)
FAILING = next(k for k in range(2) if draw_instance(PLAN, k).fails)
INSTANCE = draw_instance(PLAN, FAILING)
AXIS = INSTANCE.life.axis
SHARES = np.array([0.25, 0.75])


def cycles_of(seed):
    """Cycles whose torque is random; temperature, payload, friction and damage change it."""
    rng = np.random.default_rng(seed)
    shape = (50, 6)
    base = 20 * rng.normal(size=(1, 2, *shape)) + np.zeros((4, 1, 1, 1))
    return Cycles(
        position=rng.normal(size=shape),
        velocity=50 * rng.normal(size=shape),
        base=base,
        load=np.zeros((2, *shape)),
        friction=np.zeros((2, *shape)),
        wear=np.zeros((2, len(DAMAGES), 2, *shape)),
        loss=np.tile(rng.uniform(20, 60, 6), (4, 1)),
        wear_loss=np.zeros((2, len(DAMAGES))),
        axis=AXIS,
    )


def calendar_of(duty=0.8, ambient=20.0):
    """Three days of one shift from 6 to 18 o'clock; the second is a day off."""
    hours = np.arange(DAYS * ROWS) * 24 / ROWS
    works = (hours % 24 >= 6) & (hours % 24 < 18) & (hours // 24 != 1)
    return Calendar(
        duty=np.where(works, duty, 0.0),
        ambient=np.full(DAYS * ROWS, ambient),
        mix=np.tile(SHARES, (DAYS, 1)),
        payload=np.zeros(DAYS),
        friction=np.zeros((DAYS, 6)),
        services=np.array([2]),
        changes=np.array([], int),
    )


def recorded(monkeypatch, cycles, calendar):
    """The record of the failing robot, and the values of each day that rules look at."""
    seen = []

    def count(robot, strains, calendar, rng):
        seen.extend(strains)
        return np.zeros((len(strains), 67), int)

    monkeypatch.setattr(module, "draw_calendar", lambda *given: calendar)
    monkeypatch.setattr(module, "count_events", count)
    return record_robot(PLAN, FAILING, cycles), seen


def test_reductions_are_those_of_the_programs_by_their_shares(monkeypatch):
    """Histograms and speed are means over the programs' shares; the torque is weighted by speed."""
    cycles = [cycles_of(1), cycles_of(2)]
    one, _ = recorded(monkeypatch, cycles, calendar_of())
    robot = INSTANCE.robot()
    # two samples a day, from midnight and noon; none on the day off
    assert one.day == pytest.approx([0.5, 1.0, 2.5, 3.0])
    assert one.production == pytest.approx(0.4)  # half of each, at 0.8
    low, high = robot.joint_range.T
    limits = {
        "speed": (-robot.motor_velocity_limit, robot.motor_velocity_limit),
        "angle": (low, high),
        "torque": (-robot.motor_torque_limit, robot.motor_torque_limit),
    }
    values = {
        "speed": [each.velocity for each in cycles],
        "angle": [each.position / robot.gear_ratio for each in cycles],
        "torque": [each.base[0, 0] for each in cycles],
    }
    for name, (first, second) in values.items():
        want = 0.25 * histogram(first, *limits[name]) + 0.75 * histogram(second, *limits[name])
        stored = getattr(one, f"{name}_histogram")
        np.testing.assert_allclose(stored, np.tile(want, (4, 1, 1)), atol=1e-12)
    rates = [np.abs(each) for each in values["speed"]]
    speed = 0.25 * rates[0].mean(axis=0) + 0.75 * rates[1].mean(axis=0)
    np.testing.assert_allclose(one.speed_indicator, np.tile(0.4 * speed, (4, 1)))
    weighted = sum(
        share * (rate * np.abs(torque) ** LIFE_EXPONENT).mean(axis=0)
        for share, rate, torque in zip(SHARES, rates, values["torque"], strict=True)
    )
    torque = (0.4 * weighted / speed) ** (1 / LIFE_EXPONENT)
    np.testing.assert_allclose(one.torque_indicator, np.tile(torque, (4, 1)))


def test_gearboxes_warm_by_what_the_programs_lose(monkeypatch):
    """In steady production by the rise that belongs to the robot's cooling, times duty and loss."""
    cycles = [cycles_of(1), cycles_of(2)]
    calendar = replace(calendar_of(), duty=np.full(DAYS * ROWS, 0.7))
    one, seen = recorded(monkeypatch, cycles, calendar)
    loss = np.array([each.loss[0] for each in cycles])
    rise = RISE * INSTANCE.cooling * 0.7 * (SHARES @ loss) / loss.mean(axis=0)
    assert one.truth["gearbox_temperature"][-1] == pytest.approx(20 + rise, abs=1e-3)
    assert seen[-1].temperature == pytest.approx(20 + rise, abs=1e-3)


def test_the_cabinet_is_warmer_than_the_hall_while_the_robot_runs(monkeypatch):
    """By 8 K if it runs all the time, give or take half a kelvin."""
    cycles = [cycles_of(1), cycles_of(2)]
    found = {}
    for duty in (0.01, 1.0):
        calendar = replace(calendar_of(), duty=np.full(DAYS * ROWS, duty))
        warm = recorded(monkeypatch, cycles, calendar)[0].temperature - 20
        assert len(warm) == 6 and warm.std() < 1.2
        found[duty] = warm.mean()
    assert found[0.01] == pytest.approx(0.1, abs=0.8)
    assert found[1.0] == pytest.approx(8.0, abs=0.8)


def test_rules_look_at_the_worst_of_a_day(monkeypatch):
    """Relative to the largest torque at 41 deg C of all programs; nothing on a day off."""
    cycles = [cycles_of(1), cycles_of(2)]
    damaged = cycles[1].base[0].copy()
    more = np.zeros((2, len(DAMAGES), 2, 50, 6))
    more[:, :, 0, 7, AXIS - 1] = DAMAGES  # grows in proportion to damage
    cycles[1] = replace(cycles[1], wear=1000 * more)
    one, (first, off, last) = recorded(monkeypatch, cycles, calendar_of())
    usual = np.abs([each.base[0, 0] for each in cycles]).max(axis=(0, 1))
    shown = one.truth["shown_damage"][[0, -1]]
    for day, damage in zip((first, last), shown, strict=True):
        torque = damaged[0].copy()
        torque[7, AXIS - 1] += 1000 * damage
        peak = np.maximum(np.abs(torque).max(axis=0), np.abs(cycles[0].base[0, 0]).max(axis=0))
        assert day.torque == pytest.approx(peak / usual)
        off_by = np.zeros(6)
        off_by[AXIS - 1] = 1000 * damage
        assert day.deviation == pytest.approx(off_by / usual)
        errors = np.abs([each.base[0, 1] for each in cycles]).max(axis=(0, 1))
        assert day.position_error == pytest.approx(errors)
        assert day.cycles == pytest.approx(12 * 3600 * 0.8 / cycles[0].period)
        assert day.hall == 20.0
    assert not off.torque.any() and not off.deviation.any() and off.cycles == 0


def test_hidden_truth_is_that_of_the_plan(monkeypatch):
    """Damage ends at 1, the remaining life at 0, at the end of the last day."""
    one, _ = recorded(monkeypatch, [cycles_of(1), cycles_of(2)], calendar_of())
    damage = INSTANCE.life.damage(np.array([0.5, 0.5, 2.5, 2.5]))
    np.testing.assert_allclose(one.truth["damage"], damage)
    np.testing.assert_allclose(one.truth["remaining_life"], 3 - one.day)
    assert one.truth["damaged_axis"].tolist() == [AXIS] and (one.failed, one.axis) == (True, AXIS)
    assert one.truth["services"].tolist() == [2]
    life = INSTANCE.life
    at_end = [life.friction, life.backlash, life.ripple]
    assert one.truth["severity_at_failure"].tolist() == at_end


def test_cycles_add_up():
    """Polynomials of temperature and damage, and slopes of payload and friction, written out."""
    rng = np.random.default_rng(4)
    shape = (2, 5, 6)
    slope, bend, load, friction = rng.normal(size=(4, *shape))
    wear, wear_loss = rng.normal(size=(2, *shape)), np.array([3.0, 5.0])

    def base(warm):
        return 1.0 + slope * warm + bend * (warm / 50) ** 3

    damages = np.array(DAMAGES)
    cycles = Cycles(
        position=np.zeros(shape[1:]),
        velocity=np.zeros(shape[1:]),
        base=np.stack([base(t * np.ones(6)) for t in TEMPERATURES]),
        load=load,
        friction=friction,
        wear=wear[:, None] * (damages + damages**2)[:, None, None, None],
        loss=np.outer(np.ones(4), np.arange(6.0)),
        wear_loss=np.outer(wear_loss, damages**2),
        axis=3,
    )
    warm, rough = np.array([35.0, 45, 51, 60, 70, 75]), 0.1 * rng.normal(size=6)
    grown = np.ones(6)
    grown[2] += rough[2]
    part = (51.0 - 41.0) / 20.0
    worn = grown * (0.7 + 0.49) * ((1 - part) * wear[0] + part * wear[1])
    sound = base(warm) + 0.2 * load + rough * friction
    np.testing.assert_allclose(cycles.at(warm, 0.2, rough, 0.0), sound)
    np.testing.assert_allclose(cycles.at(warm, 0.2, rough, 0.7), sound + worn)
    beyond = [cycles.at(warm + 40 * k, 0.0, 0 * rough, damage) for k, damage in ((1, 2), (2, 9))]
    np.testing.assert_allclose(*[one[:, :, 3:] for one in beyond])
    losses = cycles.losses(np.array([0.0, 0.7]))
    want = np.tile(np.arange(6.0), (2, 4, 1))
    want[1, :, 2] += 0.49 * np.array([3.0, 3.0, 5.0, 5.0])  # constant beyond the two nodes
    np.testing.assert_allclose(losses, want)
    sound = replace(cycles, axis=0)
    np.testing.assert_allclose(sound.losses(np.array([0.7])), want[:1])
    np.testing.assert_allclose(sound.at(warm, 0.2, rough, 0.7), cycles.at(warm, 0.2, rough, 0.0))
    assert cycles.period == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("reach", "share"), [(1.0, 1.0), (0.8, 0.7), (0.5, 0.4), (0.3, 0.2), (0.1, 0.0)]
)
def test_a_program_is_shifted_as_far_as_the_robot_can(monkeypatch, reach, share):
    """A smaller shift is tried where it cannot; without any, the reason is told."""
    program = replace(INSTANCE.programs[0], shift=np.full(6, 0.5))

    def within(motion, robot, shift, speed):
        if np.abs(shift).max() > 0.5 * reach:
            raise InputError("joint 3 would leave its range")
        return shift, speed

    monkeypatch.setattr(cycles_module, "shifted", within)
    shift, speed = program_motion(INSTANCE.robot(), program)
    assert shift == pytest.approx(0.5 * share) and speed == program.speed
    reach = -1.0
    with pytest.raises(InputError, match="would leave its range"):
        program_motion(INSTANCE.robot(), program)


# Events


def strains(days, **values):
    """Days that are alike, of a robot that works as usual unless values are given."""
    usual = {"torque": 1.0, "deviation": 0.05, "position_error": 1e-3, "temperature": 40.0}
    arrays = {name: np.full(6, value) for name, value in (usual | values).items()}
    return [Strain(**arrays, hall=values.get("hall", 25.0), cycles=1000.0)] * days


def counted(days, seed, **more):
    """Events of a robot over some days, with a calendar of the plan."""
    plan = PLAN.model_copy(update={"days": len(days)})
    calendar = draw_calendar(plan, INSTANCE, 6, np.random.default_rng(seed))
    none = np.zeros(0, int)
    calendar = replace(calendar, **({"services": none, "changes": none} | more))
    return count_events(INSTANCE.robot(), days, calendar, np.random.default_rng(seed))


def test_a_third_of_the_kinds_hardly_ever_occurs():
    """Every two hundred days, while the others have a median of four in ten days."""
    own = [event_names().index(name) for name in event_names() if not name[-1].isdigit()]
    alone = [event_names()[k] not in ("program_stopped", "emergency_stop", "restart") for k in own]
    kinds = np.array(own)[alone]
    totals = np.concatenate(
        [counted(strains(400), seed)[:, kinds].sum(axis=0) for seed in range(8)]
    )
    assert np.mean(totals < 10) == pytest.approx(1 / 3, abs=0.12)
    assert np.median(totals[totals >= 10]) == pytest.approx(160, rel=0.4)


def test_names_are_those_of_six_axes_unless_told():
    assert len(event_names()) == len(event_names(6)) == 67
    assert len(event_names(7)) - len(event_names(6)) == len(AXIS_EVENTS)
    assert event_names(2)[:2] == (f"{next(iter(AXIS_EVENTS))}_1", f"{next(iter(AXIS_EVENTS))}_2")


@pytest.mark.parametrize(
    ("value", "kind", "limit"),
    [
        ("torque", "motor_torque_limit", 1.06),
        ("deviation", "motion_supervision", 0.11),
        ("position_error", "position_deviation", 1.25e-3),
        ("temperature", "gearbox_temperature", 46.0),
    ],
)
def test_a_rule_counts_what_exceeds_its_limit(value, kind, limit):
    """Far below it nothing, far above it as many as operators put up with, twenty a day."""
    columns = [event_names().index(f"{kind}_{axis}") for axis in range(1, 7)]
    usual = strains(1)[0]
    step = limit - getattr(usual, value)[0]
    for off, low, high in ((-1.0, 0.0, 0.2), (1.0, 12.0, 20.5)):
        days = strains(50) + strains(200, **{value: np.full(6, limit) + off * step})
        mean = counted(days, 3)[50:, columns].mean()
        assert low <= mean <= high, off


def test_one_collision_stops_a_program_nine_times_in_ten():
    """Days with collisions have so many more stops; every second one ends in an emergency stop."""
    names = event_names()
    counts = np.concatenate([counted(strains(400), seed) for seed in range(40)])
    collisions = counts[:, names.index("collision")]
    hit = collisions > 0
    assert collisions[hit].sum() > 1000
    for name, chance in (("program_stopped", 0.9), ("emergency_stop", 0.5)):
        column = counts[:, names.index(name)]
        more = (column[hit].mean() - column[~hit].mean()) / collisions[hit].mean()
        assert more == pytest.approx(chance, abs=0.15), name


def test_a_service_is_one_event():
    days = strains(40)
    done = counted(days, 3, services=np.array([5, 17])) - counted(days, 3)
    column = event_names().index("service_done")
    assert np.flatnonzero(done[:, column]).tolist() == [5, 17] and done.sum() == 2
