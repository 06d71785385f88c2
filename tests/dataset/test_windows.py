"""Datasets in memory: sequences of runs, and windows of signals for PyTorch and JAX."""

import pickle
from multiprocessing import get_context

import h5py
import numpy as np
import pytest

import faultgen
from faultgen.dataset.experiment import Experiment
from faultgen.errors import InputError

CYCLES, AXES = 4, 6


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Two tasks and two effects, with a validation part; worn from the third cycle on."""
    folder = tmp_path_factory.mktemp("windows") / "data"
    experiment = Experiment(
        robot=["puma560"],
        task=["spot_weld"],
        effect=["friction_wear", "viscous_friction"],
        axis=[[2]],
        schedule=[0.0, 0.001, 0.1, 0.2],
        cycles=CYCLES,
        thin=20,
        repetitions=3,
    )
    faultgen.generate(experiment, folder, workers=1, progress=False)
    return faultgen.open_dataset(folder)


def test_a_dataset_is_a_sequence_of_its_runs(dataset):
    """Numbers give runs, and slices give datasets that have these runs only."""
    assert len(dataset) == len(dataset.runs) == 9
    assert dataset[0].id == dataset.runs[0].id and dataset[-1].id == dataset.runs[-1].id
    assert [run.id for run in dataset] == [run.id for run in dataset.runs]
    part = dataset[2:8:2]
    assert [run.id for run in part] == [dataset.runs[k].id for k in (2, 4, 6)]
    assert set(part.planned) == {run.id for run in part} and part.missing == []
    assert [run.id for run in part[1:]] == [run.id for run in part][1:]
    frame = part.to_dataframe()
    assert list(dict.fromkeys(frame["run"])) == [run.id for run in part]
    with pytest.raises(IndexError):
        dataset[9]
    alone = faultgen.open_dataset(dataset.path / "dataset.h5")
    assert [run.id for run in alone[:2]] == [run.id for run in dataset[:2]]


def test_groups_name_the_robot_or_the_seed(dataset):
    """Both have one value for each cycle of a run."""
    _, _, seeds = dataset.to_xy()
    _, _, robots = dataset.to_xy(groups="robot")
    assert len(set(seeds)) == 9 and set(robots) == {f"puma560-{dataset[0]['model_sha256'][:8]}"}
    with pytest.raises(InputError, match="groups: must be seed or robot, not 'axis'"):
        dataset.to_xy(groups="axis")


def stored(dataset, run, name):
    with h5py.File(dataset.path / f"runs/{run}.h5") as file:
        return file[name][()]


def test_windows_are_pieces_of_the_signals(dataset):
    """In the order of runs, cycles and time; samples that fill no window are left out."""
    found = dataset.batches(7, window=50, stride=30, signals=["motor_torque", "reference_position"])
    assert found.channels[1] == "motor_torque_2" and found.channels[-1] == "reference_position_6"
    x = np.concatenate([x for x, _ in found])
    y = np.concatenate([y for _, y in found])
    wanted = []
    for run in dataset:
        torque = stored(dataset, run.id, "signals/motor_torque")
        reference = stored(dataset, run.id, "command/reference_position")
        for cycle in range(CYCLES):
            for start in range(0, torque.shape[1] - 49, 30):
                part = slice(start, start + 50)
                both = np.hstack([torque[cycle, part], reference[part]]).astype(np.float32)
                wanted.append((both, 2 if run["effect"] != "healthy" and cycle > 1 else 0))
    assert x.dtype == np.float32 and len(found) == -(-len(wanted) // 7)
    np.testing.assert_array_equal(x, np.stack([one for one, _ in wanted]))
    np.testing.assert_array_equal(y, [one for _, one in wanted])


def test_whole_cycles_are_the_default_window(dataset):
    x, _ = next(iter(dataset.batches(1)))
    torque = stored(dataset, dataset[0].id, "signals/motor_torque")[0]
    assert x.shape == (1, len(torque), 3 * AXES)
    np.testing.assert_array_equal(x[0, :, 2 * AXES :], torque)


def test_labels_are_those_of_the_table(dataset):
    """Texts become numbers with the same meaning in every part; unknown lives are left out."""
    classes = ("healthy", "friction_wear", "viscous_friction")
    for part in ("train", "validation", "test"):
        found = dataset.batches(1000, label="effect", split=part)
        ((_, y),) = found
        _, wanted, _ = dataset.to_xy(label="effect", split=part)
        assert found.classes == classes
        assert [classes[k] for k in y] == wanted.tolist()
    ((_, worn),) = dataset.batches(1000, label="worn", smallest_severity=0.15)
    _, wanted, _ = dataset.to_xy(label="worn", smallest_severity=0.15)
    np.testing.assert_array_equal(worn, wanted)
    ((x, life),) = dataset.batches(1000, label="remaining_life", failure_severity=0.1)
    np.testing.assert_array_equal(life.reshape(-1, CYCLES), [[2, 1, 0, 0]] * 6)
    (x,) = dataset.batches(1000, label=None)
    assert x.shape[0] == 9 * CYCLES


def test_batches_draw_the_order_from_the_generator(dataset):
    """One seed, one order; every pass has all windows, in another order."""

    def orders(seed):
        batches = dataset.batches(5, window=40, label="severity", rng=np.random.default_rng(seed))
        return [np.concatenate([x for x, _ in batches]) for _ in range(2)]

    first, second = orders(0)
    np.testing.assert_array_equal(first, orders(0)[0])
    assert not np.array_equal(first, second) and not np.array_equal(first, orders(1)[0])
    for one in (first, second):
        np.testing.assert_array_equal(np.sort(one.sum((1, 2))), np.sort(first.sum((1, 2))))
    kept = dataset.batches(5, window=40, drop_last=True)
    assert {len(x) for x, _ in kept} == {5} and len(list(kept)) == len(kept)


def _sum_in(windows, place, queue):
    queue.put(float(windows[place][0].sum()))


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_other_processes_open_the_files_anew(dataset, method):
    """Windows whose files are open here can be read by several processes at the same time."""
    windows = dataset.batches(1, window=100).windows
    wanted = {float(windows[place][0].sum()) for place in (0, 9)}
    assert windows.files.is_open and not pickle.loads(pickle.dumps(windows.files)).is_open
    context = get_context(method)
    queue = context.Queue()
    workers = [context.Process(target=_sum_in, args=(windows, k, queue)) for k in (0, 9)]
    for worker in workers:
        worker.start()
    found = {queue.get(timeout=60) for _ in workers}
    for worker in workers:
        worker.join()
    assert found == wanted


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"window": 0}, "window: must be a whole number of at least 1, not 0"),
        ({"window": 10**6}, "window: must be at most [0-9]+, the number of samples of a cycle"),
        ({"window": 9, "stride": 1.5}, "stride: must be a whole number"),
        ({"signals": "motor_current"}, "signals: some runs hold no signals/motor_current"),
        ({"label": "colour"}, "label: there is no 'colour'"),
        ({"split": "exam"}, "split: must be 'train'"),
        ({"split": "test", "by": "task"}, "has no division by task"),
        ({"groups": "axis"}, "groups: must be seed or robot"),
    ],
)
def test_bad_choices_are_told(dataset, choice, message):
    with pytest.raises(InputError, match=message):
        dataset.batches(2, **choice)
    with pytest.raises(InputError, match="size: must be a whole number"):
        dataset.batches(0)


def test_signals_that_are_not_stored_are_told(dataset, tmp_path):
    experiment = Experiment(
        robot=["puma560"], task=["spot_weld"], axis=[[2]], schedule=[0.1], cycles=1, signals=[]
    )
    faultgen.generate(experiment, tmp_path / "data", workers=1, progress=False)
    with pytest.raises(
        InputError, match="hold no sampled signals; generate the dataset with --sig"
    ):
        faultgen.open_dataset(tmp_path / "data").batches(1)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("workers", [0, 2])
def test_pytorch_reads_windows_with_several_workers(dataset, workers):
    """The DataLoader gives what `batches` gives, in the same order."""
    torch = pytest.importorskip("torch", reason="torch is not installed; see '.[torch]'")
    choice = {"window": 60, "label": "effect", "split": "train"}
    found = dataset.to_torch(**choice, groups="robot")
    assert isinstance(found, torch.utils.data.Dataset) and len(found) == len(found.y)
    loader = torch.utils.data.DataLoader(found, batch_size=8, num_workers=workers)
    wanted = list(dataset.batches(8, **choice))
    for (x, y), (a, b) in zip(loader, wanted, strict=True):
        assert x.dtype == torch.float32 and y.dtype == torch.int64
        np.testing.assert_array_equal(x.numpy(), a)
        np.testing.assert_array_equal(y.numpy(), b)
    assert set(found.groups) == {f"puma560-{dataset[0]['model_sha256'][:8]}"}


@pytest.mark.filterwarnings("ignore")
def test_pytorch_learns_from_the_windows(dataset):
    """A linear classifier learns to tell the effects of the training part."""
    torch = pytest.importorskip("torch", reason="torch is not installed; see '.[torch]'")
    torch.manual_seed(0)
    found = dataset.to_torch(label="effect", split="train")
    x, y = next(iter(torch.utils.data.DataLoader(found, batch_size=len(found))))
    x = (x - x.mean(0)) / (x.std(0) + 1e-6)
    model = torch.nn.Linear(x[0].numel(), len(found.classes))
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-2)
    for _ in range(100):
        optimizer.zero_grad()
        torch.nn.functional.cross_entropy(model(x.flatten(1)), y).backward()
        optimizer.step()
    assert (model(x.flatten(1)).argmax(1) == y).float().mean() > 0.9


def test_without_torch_one_line_says_how_to_install_it(dataset, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "torch", None)
    with pytest.raises(InputError, match="torch is not installed; install it with: pip install"):
        dataset.to_torch()
