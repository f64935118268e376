"""The Python package: scenes, files, the trainer and the listener, on shipped scenes."""
import contextlib
import copy
import importlib.metadata
import inspect
import io
import os
import re
import shutil
import signal
import struct
import subprocess
import tempfile
import threading
import time
import unittest

import numpy

import portmet


class Types(unittest.TestCase):
    def test_all_is_typed(self):
        """Every argument and every result of what the package offers has a type."""
        for name in portmet.__all__:
            offered = getattr(portmet, name)
            parts = vars(offered).items() if isinstance(offered, type) else [("", offered)]
            for part, function in parts:
                function = getattr(function, "fget", function)
                if not inspect.isfunction(function) or (part[:1] == "_" and part not in ("__init__", "__getitem__")):
                    continue
                signature = inspect.signature(function)
                untyped = [p.name for p in signature.parameters.values() if p.name != "self" and p.annotation is p.empty]
                self.assertEqual(untyped, [], f"{name}.{part}")
                self.assertIsNot(signature.return_annotation, signature.empty, f"{name}.{part}")

    @unittest.skipUnless(shutil.which("mypy"), "mypy is not installed")
    def test_mypy(self):
        package = os.path.dirname(portmet.__file__)
        modules = sorted(os.path.join(package, name) for name in os.listdir(package) if name.endswith(".py"))
        with tempfile.TemporaryDirectory() as folder:
            run = subprocess.run(["mypy", "--strict", "--ignore-missing-imports", "--follow-imports=silent",
                                  "--allow-subclassing-any", "--cache-dir", folder, *modules], capture_output=True, text=True)
        self.assertEqual(run.returncode, 0, run.stdout + run.stderr)


class Scenes(unittest.TestCase):
    def test_same_bits_as_the_program(self):
        for name, steps in (("double_pendulum", 40), ("gas_containers", 20), ("beam", 10), ("crossed_beams", 2)):
            with self.subTest(name), tempfile.TemporaryDirectory() as folder:
                scene, path = f"configs/{name}.yaml", os.path.join(folder, "run.h5")
                subprocess.run(["portmetd", "run", scene, "--in-process", "--quiet", "--steps", str(steps),
                                "--record", path], check=True)
                recorded = portmet.Recording(path)
                stepped = portmet.Scene(scene)
                for i in range(steps + 1):
                    for part, mine in stepped.subsystems.items():
                        theirs = recorded.subsystems[part]
                        self.assertEqual(mine.state.tobytes(), theirs["z"][i].tobytes())
                        self.assertEqual(mine.energy, theirs["E"][i])
                        self.assertEqual(mine.entropy, theirs["S"][i])
                    for port, mine in stepped.ports.items():
                        theirs = recorded.ports[port]
                        both = [theirs["energy_flux_a"][i], theirs["energy_flux_b"][i]]
                        numpy.testing.assert_array_equal(mine.energy, both)
                        self.assertEqual(numpy.isnan(both).all(), i == 0)  # nothing has flowed before the first step
                    self.assertEqual(stepped.ledger.energy, recorded.ledger["energy"][i])
                    if i < steps:
                        stepped.step()

    def test_nothing_is_copied(self):
        scene = portmet.Scene("configs/double_pendulum.yaml")
        state, q = scene.state, scene["upper"]["q"]
        before = q.copy()
        scene.step(3)
        self.assertIs(state, scene.state)
        self.assertTrue(numpy.shares_memory(q, state))
        self.assertFalse(numpy.array_equal(q, before))
        with self.assertRaises(ValueError):
            state[0] = 1.0
        del scene  # the arrays keep the scene open
        self.assertTrue(numpy.isfinite(state).all())

    def test_restart(self):
        scene = portmet.Scene("configs/double_pendulum.yaml")
        start = scene.state.copy()
        end = scene.step(5).state.copy()
        self.assertEqual(scene.restart(start).step(5).state.tobytes(), end.tobytes())
        self.assertEqual(scene.restart().state.tobytes(), start.tobytes())
        with self.assertRaises(ValueError):
            scene.restart(start[1:])

    def test_no_restart_without_an_energy(self):
        for name in "driven_lower", "double_pendulum", "gas_containers", "crossed_beams", "beam", "driven_upper":
            scene, plain = portmet.Scene(f"configs/{name}.yaml"), portmet.Scene(f"configs/{name}.yaml")
            scene.step(2)
            plain.step(2)
            with self.subTest(name), tempfile.TemporaryDirectory() as folder:
                path = os.path.join(folder, "run.h5")
                scene.record(path)
                for size in 1e308, 1e160:
                    with self.assertRaises(portmet.Error) as refused:
                        scene.restart(numpy.full(scene.state.shape, size))
                    self.assertEqual(refused.exception.code, 9)
                    self.assertRegex(str(refused.exception), "^subsystem .* cannot begin")
                for _ in range(3):
                    for array in "state", "energy", "entropy", "bulk_energy", "bulk_entropy", "flux", "coenergy":
                        self.assertEqual(getattr(scene, array).tobytes(), getattr(plain, array).tobytes(), array)
                    self.assertEqual((scene.steps, repr(scene.ledger)), (plain.steps, repr(plain.ledger)))
                    scene.step()
                    plain.step()
                scene.close()
                self.assertEqual(list(portmet.Recording(path).step), [2, 3, 4, 5])

    def test_nothing_flows_at_the_start(self):
        import h5py
        scene = portmet.Scene("configs/live_double_pendulum.yaml")
        for _ in range(2):
            for means in scene.flux, scene.bulk_energy, scene.bulk_entropy:
                self.assertTrue(numpy.isnan(means).all())
            self.assertTrue(numpy.isfinite(scene.ledger.energy_residual))
            scene.step()
            for means in scene.flux, scene.bulk_energy, scene.bulk_entropy:
                self.assertTrue(numpy.isfinite(means).all())
            scene.restart()
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "run.h5")
            scene.record(path).step(2).close()
            with h5py.File(path) as file:
                for name, values in file["live"].items():
                    self.assertEqual(numpy.isnan(values[:]).tolist(), [True, False, False], name)

    def test_inputs(self):
        scene = portmet.Scene("configs/driven_lower.yaml")
        free = scene.step(3).state.copy()
        name = next(n for n in scene.input_names if "dE/d" in n).rpartition("[")[0]
        scene.restart().set_input(name, 7.0)
        self.assertNotEqual(scene.step(3).state.tobytes(), free.tobytes())
        scene.restart().set_input(name, numpy.nan)
        self.assertEqual(scene.step(3).state.tobytes(), free.tobytes())
        with self.assertRaises(KeyError):
            scene.set_input("nobody", 0)

    def test_container(self):
        with portmet.Scene("configs/double_pendulum.yaml") as scene:
            self.assertEqual((list(scene), len(scene)), (["upper", "lower"], 2))
            self.assertTrue("upper" in scene and "joint" not in scene)
            self.assertEqual((list(scene["upper"]), "p" in scene["upper"], len(scene["upper"])), (["q", "p", "s"], True, 3))
            state = scene.step().state
        self.assertIn("closed", repr(scene))
        self.assertTrue(numpy.isfinite(state).all())  # arrays stay
        with self.assertRaisesRegex(portmet.Error, "double_pendulum is closed"):
            scene.step()
        scene.close()

    def test_closing_completes_a_recording(self):
        with tempfile.TemporaryDirectory() as folder:
            with portmet.Scene("configs/double_pendulum.yaml") as scene:
                scene.record(os.path.join(folder, "run.h5")).step(2)
            self.assertEqual(len(portmet.Recording(os.path.join(folder, "run.h5")).time), 3)

    def test_copies_go_on_with_the_same_bits(self):
        for name in "driven_lower", "gas_containers", "crossed_beams", "driven_upper", "double_pendulum_fast":
            scene = portmet.Scene(f"configs/{name}.yaml")
            with self.subTest(scene.name):
                scene.step(3)
                if len(scene.inputs) > 0:
                    scene.inputs[1] = 0.5
                other = copy.copy(scene)
                self.assertIsNot(other, scene)
                for _ in range(3):
                    self.assertEqual((other.steps, other.time, repr(other.ledger)), (scene.steps, scene.time, repr(scene.ledger)))
                    for name in "state", "energy", "entropy", "bulk_energy", "bulk_entropy", "flux", "inputs":
                        self.assertEqual(getattr(other, name).tobytes(), getattr(scene, name).tobytes(), name)
                    scene.step()
                    other.step()
                other.restart()
                self.assertEqual(scene.steps, 6)

    def test_efforts(self):
        scene, plain = portmet.Scene("configs/driven_lower.yaml"), portmet.Scene("configs/driven_lower.yaml")
        scene.step(4)
        plain.step(4)
        i = scene.coenergy_names.index(f"{next(iter(scene))}.dE/dp[0]")
        self.assertEqual(scene.coenergy_units[i], "m/s")
        self.assertEqual(len(scene.reaction), len(scene.reaction_names))
        # The derivative of the energy along a direction, by finite differences.
        dz, coenergy = numpy.cos(numpy.arange(len(scene.state))), scene.coenergy
        energies = [plain.copy().restart(scene.state + h * dz).energy.sum() for h in (-1e-6, 1e-6)]
        self.assertAlmostEqual((energies[1] - energies[0]) / 2e-6, coenergy @ dz, delta=1e-6 * abs(coenergy).max())
        # Asking changes nothing.
        self.assertEqual(scene.step(3).state.tobytes(), plain.step(3).state.tobytes())
        self.assertEqual(repr(scene.ledger), repr(plain.ledger))

    def test_error(self):
        with self.assertRaisesRegex(portmet.Error, "nowhere.yaml") as caught:
            portmet.Scene("nowhere.yaml")
        self.assertEqual(caught.exception.code, 4)

    def test_every_failure_is_an_error(self):
        scene = portmet.Scene("configs/driven_lower.yaml")
        for code, fails in ((2, lambda: portmet.Scene()), (2, lambda: scene.restart("start")),
                            (2, lambda: scene.set_input("hand.dE/dq", [1, 2, 3])),
                            (2, lambda: portmet.Listener("udpm://239.255.76.67:many")), (2, lambda: portmet.Listener(channels="[")),
                            (7, lambda: portmet.Listener("udpm://192.0.2.1:7667")),
                            (4, lambda: portmet.Dataset("nowhere.h5")),
                            (4, lambda: portmet.Recording("README.md")), (4, lambda: portmet.Weights("README.md")),
                            (4, lambda: portmet.Recording("configs/weights/driven_lower/link.h5")),
                            (4, lambda: portmet.Weights("configs/reference/driven_lower.h5")),
                            (4, lambda: portmet.Dataset("configs/weights/driven_lower/link.h5"))):
            with self.assertRaises(portmet.Error) as caught:
                fails()
            self.assertEqual(caught.exception.code, code, caught.exception)

    def test_wrong_arguments_are_named(self):
        dataset = {"z": numpy.zeros((1, 3, 1)), "dt": 0.1, "columns": ["a"]}
        data, scene = portmet.Dataset(**dataset), portmet.Scene("configs/driven_lower.yaml")
        for named, fails in (("path=3", lambda: portmet.Scene(3)), ("text=3", lambda: portmet.Scene(text=3)),
                             ("text='.udc80'", lambda: portmet.Scene(text="\udc80")),
                             (r"a.*x00.*b", lambda: portmet.Scene("a\0b")), ("text='a.*x00", lambda: portmet.Scene(text="a\0b")),
                             ("path=12", lambda: portmet.Dataset(12)), ("dt='x'", lambda: portmet.Dataset(**{**dataset, "dt": "x"})),
                             ("z='abc'", lambda: portmet.Dataset(**{**dataset, "z": "abc"})), ("columns=3", lambda: portmet.Dataset(
                                 **{**dataset, "columns": 3})), ("Dataset: .*nobody", lambda: portmet.Dataset(nobody=3)),
                             ("path=3", lambda: data.save(3)), ("path='nowhere", lambda: data.save("nowhere\0")),
                             ("path=None", lambda: portmet.Weights(None)), ("path=3", lambda: portmet.Recording(3)),
                             ("scene=3", lambda: portmet.propose(3)), ("tables=None", lambda: portmet.import_tables(None, "x")),
                             ("config=None", lambda: portmet.fit(None, "x")), ("tables=3", lambda: portmet.evaluate("x", data=3)),
                             ("name=3", lambda: portmet.Remote(3)), ("timeout='a'", lambda: portmet.Remote("z", timeout="a")),
                             ("timeout=-1", lambda: portmet.Remote("z", timeout=-1)), ("timeout=0", lambda: portmet.Remote("z", timeout=0)),
                             ("timeout=nan", lambda: portmet.Remote("z", timeout=numpy.nan)), ("url=3", lambda: portmet.Remote("z", url=3)),
                             ("count=1.5", lambda: scene.step(1.5)), ("state=.start", lambda: scene.restart("start")),
                             ("name=.hand.*value=.1, 2, 3", lambda: scene.set_input("hand.dE/dq", [1, 2, 3])),
                             ("path=3", lambda: scene.record(3)), ("name=", lambda: scene[[]]), ("recording=3", lambda: portmet.plot(3)),
                             ("path=3", lambda: portmet.Fleet(3, 1)), ("n='x'", lambda: portmet.Fleet(scene, "x")),
                             ("url=3", lambda: portmet.Listener(3)), ("path=3", lambda: portmet.Part(3, dt=1, initial={}))):
            with self.subTest(named):
                with self.assertRaisesRegex(portmet.Error, named) as caught:
                    fails()
                self.assertEqual(caught.exception.code, 2, caught.exception)
        library = portmet._library.library
        for patience in -1.0, numpy.nan:
            pointer = portmet._library.ctypes.c_void_p()
            self.assertEqual(library.portmet_scene_connect(pointer, b"z", None, None, None, patience), 2)

    def test_a_failed_step_is_not_taken(self):
        scene, plain = portmet.Scene("configs/driven_lower.yaml"), portmet.Scene("configs/driven_lower.yaml")
        scene.step(3)
        plain.step(3)
        scene.inputs[:] = 1e200
        with self.assertRaises(portmet.Error) as caught:
            scene.step(5)
        self.assertEqual(caught.exception.code, 9)
        scene.inputs[:] = numpy.nan
        for _ in range(20):
            for name in "state", "energy", "entropy", "bulk_energy", "bulk_entropy", "flux":
                self.assertEqual(getattr(scene, name).tobytes(), getattr(plain, name).tobytes(), name)
            self.assertEqual(repr(scene.ledger), repr(plain.ledger))
            self.assertEqual(scene.step().steps, plain.step().steps)

    def test_wrong_arguments(self):
        scene = portmet.Scene("configs/driven_lower.yaml").step(2)
        state, nowhere = scene.state.copy(), numpy.full(scene.state.shape, numpy.nan)
        for wrong in (lambda: scene.step(-1), lambda: scene.step(2**64 + 1), lambda: scene.step(1.5),
                      lambda: scene.restart(nowhere), lambda: scene.restart(state[1:]), lambda: scene["nobody"],
                      lambda: scene.set_input("nobody", 0), lambda: portmet.Listener("tcp://here")):
            with self.assertRaises(portmet.Error):
                wrong()
            self.assertEqual((scene.steps, scene.state.tobytes()), (2, state.tobytes()))
        library = portmet._library.library
        for succeeds in library.portmet_scene_stop, lambda pointer: library.portmet_scene_step(pointer, 0):
            with self.assertRaises(portmet.Error):
                portmet.Scene("nowhere.yaml")
            self.assertEqual((succeeds(scene._pointer), library.portmet_error()), (0, b""))
        for code in (library.portmet_scene_interrupt_after(scene._pointer, 0.1), library.portmet_scene_wait(scene._pointer)):
            self.assertEqual(code, 2)
            self.assertIn(b"is stepped here", library.portmet_error())

    def test_weights_of_another_system(self):
        with self.assertRaisesRegex(portmet.Error, 'of the system "double_pendulum_fast", the scene is of') as refused:
            portmet.Scene("configs/double_pendulum.yaml", weights="configs/weights/double_pendulum_fast")
        self.assertEqual(refused.exception.code, 6)
        portmet.Scene("configs/double_pendulum.yaml", weights="configs/weights/double_pendulum_wide").step(1)

    def test_interruption(self):
        scene = portmet.Scene("configs/double_pendulum.yaml")
        timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        begin = time.process_time()
        with self.assertRaises(KeyboardInterrupt):
            scene.step(10**6)
        self.assertLess(time.process_time() - begin, 3)
        timer.join()

    def test_threads_do_not_share_a_scene(self):
        scene, plain = portmet.Scene("configs/double_pendulum.yaml"), portmet.Scene("configs/double_pendulum.yaml")
        refused = []

        def work():
            for _ in range(200):
                try:
                    scene.step()
                except portmet.Error as error:
                    refused.append(error)
        threads = [threading.Thread(target=work) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(scene.steps + len(refused), 800)
        self.assertTrue(all(error.code == 2 and "another thread" in str(error) for error in refused))
        self.assertEqual(plain.step(scene.steps).state.tobytes(), scene.state.tobytes())
        self.assertEqual(repr(plain.ledger), repr(scene.ledger))

    def test_part(self):
        part = portmet.Part("configs/weights/double_pendulum/upper.h5", dt=0.01,
                            initial={"q": [1.5, 0.5], "p": 0, "s": 0})
        energy = part.energy[0]
        for initial in {"q": 0, "p": 0}, {"q": [1, 2, 3], "p": 0, "s": 0}, {"q": "x", "p": 0, "s": 0}:
            with self.assertRaises(portmet.Error):
                portmet.Part("configs/weights/double_pendulum/upper.h5", dt=0.01, initial=initial)
        part.step(100)
        self.assertNotEqual(part["part"]["q"][0], 1.5)
        self.assertAlmostEqual(part.energy[0], energy, delta=1e-6 * abs(energy))


class Files(unittest.TestCase):
    def test_dataset(self):
        data = portmet.Scene("configs/double_pendulum.yaml").reference
        self.assertEqual(data.z.shape, (1, 200, 10))
        self.assertEqual(data["q1x"].shape, (1, 200))
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "copy.h5")
            data.save(path)
            data.save(path)
            for other in "README.md", "configs/weights/double_pendulum/upper.h5":
                kept = shutil.copy(other, folder)
                with self.assertRaisesRegex(portmet.Error, "of another kind"):
                    data.save(kept)
                self.assertEqual(os.path.getsize(kept), os.path.getsize(other))
            again = portmet.Dataset(path)
            linked = os.path.join(folder, "linked.h5")
            os.link(path, linked)
            for own in path, linked:  # the file from which it was read stays
                with open(own, "rb") as file:
                    before = file.read()
                with self.assertRaisesRegex(ValueError, "was read from this file"):
                    again.save(own)
                with open(own, "rb") as file:
                    self.assertEqual(file.read(), before)
            for end in "/dev/null", os.path.join(folder, "nothing.h5"):
                symbolic = os.path.join(folder, "symbolic.h5")
                os.symlink(end, symbolic)
                with self.assertRaisesRegex(portmet.Error, "this is a symbolic link"):
                    again.save(symbolic)
                os.remove(symbolic)
            self.assertEqual(again.z.tobytes(), data.z.tobytes())
            self.assertEqual((again.columns, again.dt, again.notes), (data.columns, data.dt, data.notes))
            # portmetd accepts it, too.
            found = portmet.evaluate("configs/double_pendulum.yaml", data=path)
            self.assertEqual(list(found.errors), ["q", "p", "s"])
            self.assertEqual((found.truth.shape, found.columns), (data.z.shape, data.columns))
            for group, errors in found.errors.items():
                columns = [i for i, name in enumerate(found.columns) if name.startswith(group)]
                apart = numpy.linalg.norm((found.prediction - found.truth)[0][:, columns])
                self.assertAlmostEqual(errors[0], apart / numpy.linalg.norm(found.truth[0][:, columns]), delta=1e-12)
            self.assertIn("steps in violation: 0 of 199", str(found))
            self.assertEqual((list(data)[0], "q1x" in data, "q9" in data), (data.columns[0], True, False))
            tables = [os.path.join(folder, name) for name in ("a.csv", "b.csv")]
            for table in tables:
                numpy.savetxt(table, numpy.column_stack((data.t, data.z[0])), delimiter=",", comments="",
                              fmt="%.17g", header=",".join(["t", *data.columns]))
            scores = portmet.evaluate("configs/double_pendulum.yaml", data=tables).errors
            self.assertEqual(scores["q"].tolist(), 2 * [found.errors["q"][0]])

    def test_estimate(self):
        text = ("scene: tea\ntime: {dt: 5.0, steps: 40, integrator: rk4}\n"
                "models:\n  cup: {constants: {C: 800.0}, energy: ['293*C*(exp(s/C) - 1)'], entropy: {given: s}}\n"
                "  room: {constants: {C: 1500.0}, energy: ['293*C*(exp(s/C) - 1)'], entropy: {given: s}}\n"
                "  heat: {law: bracket, constants: {K: 2.0}, irreversible: {given: [[a.s, b.s, 'K*b.dE.s/a.dE.s']]}}\n"
                "subsystems:\n  cup: {model: cup, state: {s: {unit: J/K, size: 1, hidden: {guess: 120.0, deviation: 80.0}}}}\n"
                "  room: {model: room, state: {s: {unit: J/K, size: 1, hidden: {deviation: 2.0}}}}\n"
                "ports:\n  heat: {law: bracket, between: [cup, room], expose: {cup: s, room: s}, model: heat}\n"
                "observations: {T: 'cup.dE.s'}\n")
        times = numpy.cumsum(4 + numpy.arange(150) % 3.0) - 4  # they are uneven
        rate = 2 / 800 + 2 / 1500
        with tempfile.TemporaryDirectory() as folder:
            scene, tables = os.path.join(folder, "tea.yaml"), [os.path.join(folder, name) for name in ("a.csv", "b.csv")]
            with open(scene, "w") as file:
                file.write(text)
            for table, start in zip(tables, (350.0, 340.0)):
                end = (800 * start + 1500 * 293) / 2300
                temperature = end + (start - end) * numpy.exp(-rate * times)
                temperature += 0.1 * numpy.sin(1e3 * times)
                numpy.savetxt(table, numpy.column_stack((times, temperature)), delimiter=",", comments="", header="t,T")
            found = portmet.evaluate(scene, data=tables, estimate=300)
            self.assertIsInstance(found, portmet.Estimate)
            self.assertEqual((found.seconds, found.trajectories, found.columns), (300.0, [0, 1], ["T"]))
            self.assertEqual((found.components, found.states.shape), (["cup.s", "room.s"], (2, 150, 2)))
            self.assertEqual(found.truth.shape, found.prediction.shape)
            numpy.testing.assert_allclose(found.t[1], times)
            later = times > 300
            for i in range(2):
                truth, prediction = found.truth[i, :, 0], found.prediction[i, :, 0]
                expected = numpy.sqrt(numpy.mean((prediction - truth)[later] ** 2)) / numpy.std(truth)
                self.assertAlmostEqual(found.errors["T"][i], expected, delta=0.1 * expected)
                self.assertLess(found.errors["T"][i], 0.02)
            self.assertIn("T  ", str(found))
            self.assertIsNone(found.deviation)
            self.assertFalse(found.violates)
            with contextlib.suppress(ImportError):
                import matplotlib  # noqa: F401
                self.assertEqual(len(found.plot().axes[0].collections), 0)
                found.deviation = numpy.full_like(found.prediction, 0.1)
                self.assertEqual(len(found.plot(trajectory=1).axes[0].collections), 1)

    def test_ranges_of_columns(self):
        data = portmet.Dataset("configs/reference/beam_solid.h5")
        self.assertEqual(data.z.shape[2], len(data.columns))
        self.assertIn("u2267", data.columns)

    def test_weights(self):
        part = portmet.Weights("configs/weights/double_pendulum/upper.h5")
        self.assertEqual([(g.name, g.size, g.unit) for g in part.layout], [("q", 2, "m"), ("p", 2, "kg m/s"), ("s", 1, "J/K")])
        self.assertIn("form: hard", part.model)
        self.assertTrue(part.trained)
        port = portmet.Weights("configs/weights/double_pendulum/joint.h5")
        self.assertEqual((port.kind, len(port.layout)), ("port", 2))

    def test_recording(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "run.h5")
            portmet.Scene("configs/gas_containers.yaml").record(path).step(5).record(None)
            recording = portmet.Recording(path)
            self.assertEqual(list(recording.step), list(range(6)))
            part, port = next(iter(recording.subsystems)), next(iter(recording.ports))
            scene = portmet.Scene("configs/gas_containers.yaml")
            self.assertEqual(sorted(n for n in recording if n in scene.variables), sorted(scene.variables))
            self.assertEqual([recording.units[n] for n in scene.variables], scene.units)
            name = scene.variables[0]
            self.assertEqual(recording[name].tobytes(), recording.subsystems[part]["z"][:, 0].tobytes())
            self.assertEqual((recording.units[f"{part}.E"], recording.units[f"{port}.energy_flux_a"]), ("J", "W"))
            self.assertTrue(recording.units[name])
            self.assertEqual(set(recording.ends[port]) - set(recording.subsystems), set())
            with contextlib.suppress(ImportError):
                import matplotlib  # noqa: F401
                recording.plot(os.path.join(folder, "run.png"))
                self.assertGreater(os.path.getsize(os.path.join(folder, "run.png")), 10000)
            with contextlib.suppress(ImportError):
                import pandas  # noqa: F401
                frame = recording.to_dataframe()
                self.assertEqual((frame[name].iloc[2], frame.index[2]), (recording[name][2], recording.time[2]))
            with contextlib.suppress(ImportError):
                import xarray  # noqa: F401
                data = recording.to_xarray()
                self.assertEqual((float(data[name][2]), data[name].attrs["units"]), (recording[name][2], recording.units[name]))

    def test_recording_of_a_range(self):
        text = ("scene: row\ntime: {dt: 0.1, steps: 4, integrator: rk4, substeps: 2}\n"
                "models: {part: {energy: '|p|^2/2 + |q|^2/2', reversible: {given: [[q, p, 1.0]]}}}\n"
                "subsystems:\n  'm[0:3]': {model: part, initial: {q: 0.1, p: 1.0}, "
                "state: {q: {unit: m, size: 1}, p: {unit: kg m/s, size: 1}}}\n")
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "run.h5")
            scene = portmet.Scene(text=text).record(path).step(2)
            scene.close()
            recording = portmet.Recording(path)
            self.assertEqual(recording["m2.p[0]"][2], scene["m2"]["p"][0])
            self.assertEqual(recording["m1.E"][2], scene["m1"].energy)
            self.assertEqual((recording.units["m2.p[0]"], recording.units["m1.E"]), ("kg m/s", "J"))
            self.assertTrue("m0.q[0]" in recording and "m3.q[0]" not in recording)


@unittest.skipUnless(os.environ.get("PM_PRIVATE_NETWORK"), "no private network can be made here")
class Listening(unittest.TestCase):
    def test_run(self):
        with portmet.Listener(channels="double_pendulum_.*", timeout=10) as listener:
            run = subprocess.Popen(["portmetd", "run", "configs/double_pendulum.yaml", "--steps", "5", "--quiet"])
            ledgers, fluxes, unknown = [], 0, 0
            for message in listener:
                unknown += message.content is None
                fluxes += "_FLUX_" in message.channel
                if message.channel.endswith("_LEDGER"):
                    ledgers.append(message.content)
                if message.channel.endswith("_COMMAND") and message.content.kind == message.content.END:
                    break
            self.assertEqual(run.wait(), 0)
        self.assertEqual(unknown, 0)
        self.assertGreater(fluxes, 0)
        scene = portmet.Scene("configs/double_pendulum.yaml").step(5)
        self.assertEqual((ledgers[-1].step, ledgers[-1].energy), (5, scene.ledger.energy))

    def test_remote(self):
        path = "configs/double_pendulum.yaml"
        folder = tempfile.TemporaryDirectory()
        service = subprocess.Popen(["portmetd", "serve", path, "--record", folder.name], stderr=subprocess.DEVNULL)
        try:
            scene = portmet.Scene(path)
            with portmet.Remote("double_pendulum") as remote:
                self.assertEqual((remote.variables, remote.units), (scene.variables, scene.units))
                for count in 0, 1, 20:
                    remote.step(count)
                    scene.step(count)
                    self.assertEqual((remote.steps, remote.time), (scene.steps, scene.time))
                    for name in "state", "energy", "entropy", "bulk_energy", "bulk_entropy", "flux":
                        numpy.testing.assert_array_equal(getattr(remote, name), getattr(scene, name), name)
                    self.assertTrue((remote["lower"]["p"] == scene["lower"]["p"]).all())
                    numpy.testing.assert_array_equal(remote.ports["joint"].energy, scene.ports["joint"].energy)
                    self.assertEqual(repr(remote.ledger), repr(scene.ledger))
                state = 1.01 * scene.state
                remote.restart(state).step(7)
                scene.restart(state).step(7)
                self.assertTrue((remote.state == scene.state).all())
                # A state between two steps, and one that is kept.
                remote.checkpoint("seven")
                totals = remote.ledger.energy, remote.ledger.entropy
                remote.set_state(state)
                self.assertEqual((remote.steps, remote.ledger.energy, remote.ledger.entropy), (7, *totals))
                remote.step(7)
                self.assertTrue((remote.state == scene.state).all())
                self.assertEqual(remote.steps, 14)
                remote.restore("seven")
                self.assertEqual((remote.steps, remote.ledger.energy), (7, totals[0]))
                self.assertTrue((remote.state == scene.state).all())
                with self.assertRaisesRegex(portmet.Error, "nothing is kept as eight"):
                    remote.restore("eight")
                with self.assertRaisesRegex(portmet.Error, "is under way"):
                    portmet.Remote("double_pendulum")
                with self.assertRaises(ValueError):
                    remote.restart(state[1:])
            with self.assertRaisesRegex(portmet.Error, "no service of scene other"):
                portmet.Remote("other", timeout=0.2)
        finally:
            service.terminate()
            self.assertEqual(service.wait(), 0)
            folder.cleanup()

    def test_remote_inputs_hold(self):
        path, velocity = "configs/live_double_pendulum.yaml", (0.3, -0.1)
        service = subprocess.Popen(["portmetd", "serve", path], stderr=subprocess.DEVNULL)
        try:
            scene = portmet.Scene(path)
            scene.inputs[scene.input_columns("pivot.dE/dp")] = velocity
            with portmet.Remote("live_double_pendulum") as remote:
                remote.inputs[:] = velocity  # the scene waits for a message for each step
                for count in 3, 1, 1:
                    self.assertTrue((remote.step(count).state == scene.step(count).state).all())
        finally:
            service.terminate()
            self.assertEqual(service.wait(), 0)

    def test_remote_inputs_missing(self):
        path, velocity = "configs/live_double_pendulum.yaml", (0.3, -0.1)
        service = subprocess.Popen(["portmetd", "serve", path], stderr=subprocess.DEVNULL)
        try:
            scene = portmet.Scene(path)
            scene.inputs[scene.input_columns("pivot.dE/dp")] = velocity
            with portmet.Remote("live_double_pendulum", timeout=2) as remote:
                with self.assertRaisesRegex(portmet.Error, "after step 0 for a message on PIVOT.*vx.* not set") as failure:
                    remote.step(2)
                self.assertEqual(failure.exception.code, 8)
                remote.inputs[:] = velocity  # the steps that failed are not taken
                self.assertTrue((remote.step(3).state == scene.step(3).state).all())
                self.assertEqual(remote.steps, 3)
                # A run that has failed is over, and another one may begin.
                state = remote.state.copy()
                remote.inputs[:] = 1e200
                with self.assertRaises(portmet.Error) as failure:
                    remote.step(2)
                self.assertEqual((failure.exception.code, remote.steps), (9, 3))
                self.assertTrue((remote.state == state).all())
                remote.inputs[:] = velocity
                self.assertTrue((remote.restart().step(3).state == state).all())
            # Ctrl-C while nobody gives the inputs.
            with portmet.Remote("live_double_pendulum", timeout=60) as remote:
                timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
                timer.start()
                begin = time.monotonic()
                with self.assertRaises(KeyboardInterrupt):
                    remote.step(2)
                self.assertLess(time.monotonic() - begin, 30)
                timer.join()
                remote.inputs[:] = velocity
                self.assertEqual(remote.step(3).steps, 3)
        finally:
            service.terminate()
            self.assertEqual(service.wait(), 0)

    def test_remote_with_key(self):
        with tempfile.TemporaryDirectory() as folder:
            path, key = os.path.join(folder, "keyed.yaml"), os.path.join(folder, "key")
            with open(os.open(key, os.O_WRONLY | os.O_CREAT, 0o600), "wb") as file:
                file.write(os.urandom(32))
            with open(path, "w", encoding="utf-8") as file:
                file.write("scene: keyed\nkey_file: key\ntime: {dt: 0.1, steps: 10, integrator: rk4}\n"
                           "models:\n  mass: {energy: \"|p|^2/2 + |q|^2/2\", reversible: {given: [[q, p, 1.0]]}}\n"
                           "subsystems:\n  mass:\n    model: mass\n"
                           "    state: {q: {unit: m, size: 1}, p: {unit: kg m/s, size: 1}}\n"
                           "    initial: {q: 1.0, p: 0.0}\n")
            service = subprocess.Popen(["portmetd", "serve", path], stderr=subprocess.DEVNULL)
            try:
                with portmet.Remote("keyed", key_file=key) as remote:
                    self.assertTrue((remote.step(5).state == portmet.Scene(path).step(5).state).all())
                with self.assertRaisesRegex(portmet.Error, "no service of scene keyed"):
                    portmet.Remote("keyed", timeout=0.3)
            finally:
                service.terminate()
                self.assertEqual(service.wait(), 0)

    def test_publishing(self):
        with portmet.Listener(channels="HELLO") as hears, portmet.Listener() as speaks:
            speaks.publish("OTHER", b"not this")
            speaks.publish("HELLO", b"12345678 and more")
            message = hears.receive(10)
        self.assertEqual((message.channel, message.content, message.data), ("HELLO", None, b"12345678 and more"))

    def test_message_in_pieces(self):
        import socket
        import struct
        body = b"BIG\0" + bytes(range(256)) * 10
        pieces = [body[i:i + 1000] for i in range(0, len(body), 1000)]
        s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        s.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        with portmet.Listener(channels="BIG") as hears:
            for i in reversed(range(len(pieces))):
                head = struct.pack(">IIIIHH", 0x4C433033, 9, len(body), 1000 * i, i, len(pieces))
                s.sendto(head + pieces[i], ("239.255.76.67", 7667))
            message = hears.receive(10)
        s.close()
        self.assertEqual(message.data, bytes(range(256)) * 10)


class Fragments(unittest.TestCase):
    def test_forged_fragments_take_bounded_memory(self):
        listener = object.__new__(portmet.Listener)
        listener._unfinished, listener._kept = {}, 0
        for i in range(12000):  # first pieces of messages, and many pieces of one message
            for number, which in ((i, 0), (1 << 20, i)):
                head = struct.pack(">IIIIHH", 0x4C433033, number, 30 << 20, 0, which, 60000)
                self.assertIsNone(listener._join(head + bytes(65000), ("10.0.0.1", i % 7)))
            kept = sum(len(p) for pieces in listener._unfinished.values() for p in pieces.values())
            self.assertEqual(kept, listener._kept)
            self.assertLessEqual(kept, 32 << 20)


class Copies(unittest.TestCase):
    def test_same_bits_as_a_scene(self):
        scene = portmet.Scene("configs/driven_lower.yaml")
        copies = portmet.Fleet(scene, 70, threads=2)
        rng = numpy.random.default_rng(1)
        copies.state[:] += 0.01 * rng.standard_normal(copies.state.shape)
        inputs = numpy.where(rng.random(copies.inputs.shape) < 0.3, 0.1, numpy.nan)
        start, view = copies.state.copy(), copies.state
        copies.step(2, inputs).step(3)
        self.assertIs(view, copies.state)
        self.assertEqual(copies.failure, "")
        for i in (0, 33, 69):
            scene.inputs[:] = inputs[i]
            scene.restart(start[i]).step(5)
            self.assertEqual(scene.state.tobytes(), copies.state[i].tobytes())
            self.assertEqual(scene.energy.tobytes(), copies.energy[i].tobytes())
            self.assertEqual(scene.time, copies.time[i])
        del copies, scene
        self.assertTrue(numpy.isfinite(view).all())  # the array keeps the copies open

    def test_derivatives_of_rollouts(self):
        copies = portmet.Fleet("configs/driven_lower.yaml", 3)
        random = numpy.random.default_rng(0).standard_normal
        inputs, d_inputs = 0.1 * random((2, 4, 3, copies.inputs.shape[1]))
        seed, d_start = random((4, *copies.state.shape)), random(copies.state.shape)
        before, d_weights = copies.state.copy(), random((3, sum(map(len, copies.weight_names.values()))))
        states, tangents = copies.jvp(d_start, d_inputs, inputs=inputs, steps=2)
        numpy.testing.assert_array_equal(states, copies.rollout(inputs, 2))
        ends = [copies.rollout(inputs + by * d_inputs, 2, before + by * d_start) for by in (1e-5, -1e-5)]
        numpy.testing.assert_allclose(tangents, (ends[0] - ends[1]) / 2e-5, rtol=1e-6, atol=1e-6)
        by_start, by_inputs, by_weights = copies.vjp(seed, inputs, 2, weights=True)
        numpy.testing.assert_allclose((by_start * d_start).sum(1) + (by_inputs * d_inputs).sum((0, 2)),
                                      (seed * tangents).sum((0, 2)), rtol=1e-9)
        tangents = copies.jvp(d_weights=d_weights, inputs=inputs, steps=2)[1]
        numpy.testing.assert_allclose((by_weights * d_weights).sum(1), (seed * tangents).sum((0, 2)), rtol=1e-9)
        numpy.testing.assert_array_equal(copies.state, before)
        self.assertEqual(list(copies.steps), [0, 0, 0])
        self.assertRaises(portmet.Error, portmet.Fleet("configs/bouncing_masses.yaml", 1).vjp, 0.0)

    def test_ends_and_saved_copies(self):
        copies = portmet.Fleet("configs/driven_lower.yaml", 3)
        row = copies.save([1])
        copies.inputs[2] = 1e200
        copies.ended[0] = 1
        copies.step(4)
        self.assertEqual((list(copies.ended), list(copies.steps)), ([1, 0, 9], [0, 4, 0]))
        self.assertRegex(copies.failure, "^copy 2: step 1: subsystem")
        kept, size = copies.save(), copies.state.shape[1]
        for wrong in numpy.nan, numpy.inf, -1.0, 0.5, 1e300:
            spoilt = numpy.concatenate((row, row))
            spoilt[1, size] = wrong
            with self.assertRaisesRegex(portmet.Error, "row 1 of saved copies") as caught:
                copies.restore(spoilt, [0, 1])
            self.assertEqual(caught.exception.code, 2)
            self.assertEqual(copies.save().tobytes(), kept.tobytes())
        self.assertRaises(portmet.Error, copies.restore, numpy.full(row.shape, numpy.nan))
        copies.restore(row)
        self.assertEqual((list(copies.ended), list(copies.steps)), ([0, 0, 0], [0, 0, 0]))

    def test_wrong_arguments(self):
        path, copies = "configs/driven_lower.yaml", portmet.Fleet("configs/driven_lower.yaml", 3)
        row, state = copies.save([1]), copies.state.copy()
        for wrong in (lambda: portmet.Fleet(path, 0), lambda: portmet.Fleet(path, 2, 2**40), lambda: portmet.Fleet(path, 2, "x"),
                      lambda: copies.step(-1), lambda: copies.step(1, numpy.zeros(7)), lambda: copies.step(1, "x"),
                      lambda: copies.set_input("nobody", 0), lambda: copies.set_input("hand.dE/dq", [1, 2]),
                      lambda: copies.save([7]), lambda: copies.save([0.5]), lambda: copies.restore(row[:, 1:]),
                      lambda: copies.rollout(start=row[0]), lambda: copies.rollout(steps=-1), lambda: copies.rollout(pieces=-1),
                      lambda: copies.vjp(0.0, steps=2**64 + 1), lambda: copies.vjp(numpy.zeros(99)), lambda: copies.vjp("x"),
                      lambda: copies.jvp(steps=1.5), lambda: copies.jvp(numpy.zeros(99))):
            with self.assertRaises(portmet.Error) as caught:
                wrong()
            self.assertEqual(caught.exception.code, 2, caught.exception)
            self.assertEqual(copies.state.tobytes(), state.tobytes())


class Package(unittest.TestCase):
    def test_a_proposal_is_a_training_file(self):
        with tempfile.TemporaryDirectory() as folder:
            tables = []
            for k in range(3):
                t = 0.05 * numpy.arange(60)
                tables.append(os.path.join(folder, f"run_{k}.csv"))
                columns = numpy.transpose([t, numpy.cos(2 * t + k), -2 * numpy.sin(2 * t + k)])
                numpy.savetxt(tables[-1], columns, "%.12g", ",", header="t [s],q [m],v [m/s]", comments="")
            proposal = portmet.propose(data=tables, output=os.path.join(folder, "model"), budget=0)
            self.assertEqual(proposal.scene, os.path.join(folder, "model", "scene.yaml"))
            self.assertIn("q [m]: a position, whose rate is v", str(proposal))
            fit = portmet.fit(proposal, os.path.join(folder, "weights"))
            self.assertEqual(fit.verdict, "good")

    def test_metadata(self):
        self.assertEqual(importlib.metadata.version("portmet"), portmet.__version__)
        self.assertTrue(os.path.exists(os.path.join(os.path.dirname(portmet.__file__), "py.typed")))

    def test_constants_and_progress(self):
        with tempfile.TemporaryDirectory() as folder:
            def write(name, text):
                with open(os.path.join(folder, name), "w", encoding="utf-8") as file:
                    file.write(text)
                return os.path.join(folder, name)
            state = "{q: {unit: m, columns: [q]}, p: {unit: kg m/s, columns: [p]}}"
            start = "scene: spring\ntime: {dt: 0.1, steps: 50, integrator: rk4, substeps: 4}\n"
            model = "energy: 'k*|q|^2/2 + |p|^2/2', reversible: {given: [[q, p, 1.0]]}"
            true = portmet.Scene(write("true.yaml", start + f"models: {{s: {{constants: {{k: 3.0}}, {model}}}}}\n"
                                       f"subsystems: {{s: {{model: s, initial: {{q: 1.0, p: 0.0}}, state: {state}}}}}\n"))
            runs = []
            for q in 0.5, 1.0, 1.5, 2.0, 2.5:
                true.restart([q, 0.1])
                runs.append([[q, 0.1]] + [true.step().state.copy() for _ in range(50)])
            portmet.Dataset(z=runs, dt=0.1, columns=["q", "p"]).save(os.path.join(folder, "data.h5"))
            write("scene.yaml", start + f"subsystems: {{s: {{weights: weights/s.h5, state: {state}}}}}\n")
            training = write("training.yaml", "scene: scene.yaml\n"
                             f"models: {{s: {{constants: {{k: {{learned: 1.0, positive: true}}}}, {model}}}}}\n"
                             "subsystems: {s: s}\nloss: {residual: step}\nstages: [{optimiser: gauss_newton, iterations: 20, batch: 100}]\n")
            lines = io.StringIO()
            with contextlib.redirect_stdout(lines):
                fit = portmet.fit(training, os.path.join(folder, "weights"), data=os.path.join(folder, "data.h5"), progress=True)
            # Bars are overwritten by what follows a carriage return.
            self.assertIn("gauss_newton [", lines.getvalue())
            self.assertEqual(re.sub(r"[^\n]*\r", "", lines.getvalue()), fit.report)
            self.assertAlmostEqual(fit.constants["s"]["k"], 3.0, delta=1e-3)
            self.assertEqual(fit.verdict, "good")
            with self.assertRaises(portmet.Error):
                portmet.fit(training, os.path.join(folder, "weights"), data=os.path.join(folder, "nothing.h5"))


class Pages(unittest.TestCase):
    def test_copies_of_the_page(self):
        with open("daemon/LIBRARY.md", encoding="utf-8") as page:
            script = re.search(r"```python\n(.*?)```", page.read(), re.S)[1]
        space = {}
        exec(compile(script, "daemon/LIBRARY.md", "exec"), space)  # pylint: disable=exec-used
        self.assertEqual((space["copies"].failure, list(set(space["copies"].steps))), ("", [15]))

    def test_assemble(self):
        with open("daemon/examples/assemble.py", encoding="utf-8") as file:
            script = file.read()
        self.assertLessEqual(len([line for line in script.splitlines() if line]), 45)
        with tempfile.TemporaryDirectory() as folder:
            os.environ["PORTMET_EXAMPLE"] = folder
            space, here = {}, os.getcwd()
            try:
                exec(compile(script, "daemon/examples/assemble.py", "exec"), space)  # pylint: disable=exec-used
            finally:
                os.chdir(here)
            self.assertLess(space["error"], 0.01)
            fit = space["fit"]
            self.assertEqual((fit.verdict, fit.fits, fit.reasons), ("good", True, []))
            self.assertEqual(list(fit.errors), ["m0 q", "m0 p", "m1 q", "m1 p"])
            self.assertLess(fit.errors["m1 p"]["validation"], 1e-3)
            self.assertGreater(fit.errors["m1 p"]["persistence"], 0.5)
            self.assertEqual(list(fit.weights), ["m0", "m1"])
            self.assertEqual(portmet.Weights(fit.weights["m0"]).verdict, "good")
            self.assertGreater(len(fit.history), 10)
            self.assertEqual(space["chain"].ledger.violations, 0)



if __name__ == "__main__":
    unittest.main()
