"""Fields in C#, on Mono: the bits of the library, a probe, and a thread that renders it."""

import os
import re
import shutil
import subprocess

import numpy as np
import pytest
from test_header import points_for

from pandis.__main__ import main
from pandis.runtime.contact import NativeContact
from pandis.runtime.contact.surfaces import Material
from pandis.runtime.field import NativeField
from pandis.runtime.scene import Placed
from support import ROOT

pytestmark = [
    pytest.mark.skipif(not shutil.which("mcs"), reason="no Mono here: apt-get install mono-mcs"),
    pytest.mark.skipif(not shutil.which("mono"), reason="no Mono here"),
]

#: Asks at points, then follows them with a probe, and writes every bit.
PROGRAM = """
using System;
using System.IO;
using Pandis;

static class Program
{
    static int Main(string[] names)
    {
        byte[] held = File.ReadAllBytes(names[1]);
        double[] points = new double[held.Length / 8];
        Buffer.BlockCopy(held, 0, points, 0, held.Length);
        int count = points.Length / 3;
        double[] distances = new double[count], normals = new double[3 * count];
        byte[] flags = new byte[count];
        using (var output = new BinaryWriter(File.Create(names[2])))
        using (var field = new Field(names[0]))
        {
            field.Query(points, distances, normals, flags);
            foreach (double d in field.Bounds) output.Write(d);
            foreach (double d in distances) output.Write(d);
            foreach (double n in normals) output.Write(n);
            output.Write(flags);
            var turned = new double[] { 0, -1, 0, 1, 0, 0, 0, 0, 1 };
            var place = new double[] { 0.01, 0.02, 0.03 };
            using (var probe = new Probe(field, turned, place, 0.05, 400, 0.001))
            {
                probe.Friction(0.4, 0.3);
                for (int i = 0; i < 2000 && i < count; i++)
                {
                    Vector at = new Vector(points[3 * i], points[3 * i + 1], points[3 * i + 2]);
                    Vector kept, force = probe.Tick(at, 1e-3, out kept);
                    foreach (Vector v in new[] { force, kept })
                        foreach (double d in new[] { v.X, v.Y, v.Z }) output.Write(d);
                }
            }
        }
        try { new Field("missing.pandis"); }
        catch (PandisException error) { Console.WriteLine(error.Message); }
        // a probe keeps its field; what is disposed of is refused, and nothing crashes
        var other = new Field(names[0]);
        var upright = new double[] { 1, 0, 0, 0, 1, 0, 0, 0, 1 };
        var last = new Probe(other, upright, new double[3], 1, 1, 0);
        other.Dispose();
        Vector there;
        last.Tick(new Vector(100, 0, 0), 1e-3, out there);
        last.Dispose();
        try { last.Tick(new Vector(), 1e-3, out there); return 1; }
        catch (ObjectDisposedException) { }
        try { other.Query(points, distances, normals, flags); return 1; }
        catch (ObjectDisposedException) { }
        return 0;
    }
}
"""
#: A hand that is led into the object by a thread, and what happens when the device fails.
THREADS = """
using System;
using System.Threading;
using Pandis;

static class Program
{
    static void Main(string[] names)
    {
        var upright = new double[] { 1, 0, 0, 0, 1, 0, 0, 0, 1 };
        using (var field = new Field(names[0]))
        foreach (bool fails in new[] { false, true })
        using (var probe = new Probe(field, upright, new double[3], 1, 400, 0))
        {
            double height = 1.2, largest = 0, last = -1;
            long asked = 0;
            var haptics = new HapticThread(
                probe,
                () =>
                {
                    if (fails && asked == 100) throw new InvalidOperationException("unplugged");
                    height -= asked++ < 300 ? 1e-3 : 0;
                    return new Vector(0, 0, height);
                },
                force => { last = force.Length; largest = Math.Max(largest, last); },
                1000, 3.0);
            haptics.Start();
            while (haptics.Ticks < 400 && haptics.Failure == null) Thread.Sleep(1);
            double seen = haptics.Force.Length, kept = haptics.Surface.Z;
            haptics.Move(upright, new double[] { 0, 0, -1 });
            long then = haptics.Ticks;
            while (haptics.Ticks < then + 50 && haptics.Failure == null) Thread.Sleep(1);
            if (haptics.Force.Length > 0) throw new Exception("the object has not moved");
            try { haptics.Move(new double[9], new double[3]); throw new Exception("no rotation"); }
            catch (PandisException) { }
            haptics.Dispose();
            Console.WriteLine("{0} {1} {2} {3} {4} {5}", haptics.Ticks, largest, last, seen, kept,
                              haptics.Failure == null ? "whole" : haptics.Failure.Message);
        }
    }
}
"""


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """Return what compiles a program, beside what the command has written, and runs it."""
    folder = tmp_path_factory.mktemp("csharp")
    assert main(["csharp", str(folder)]) == 0

    def ran(text, *arguments):
        source, program = folder / "Program.cs", folder / "program.exe"
        source.write_text(text)
        command = ["mcs", "-langversion:7", "-warnaserror", "-r:System.dll", f"-out:{program}"]
        made = subprocess.run([*command, source, folder / "Pandis.cs"], capture_output=True,
                              text=True, check=False)  # fmt: skip
        assert not made.returncode, made.stdout + made.stderr
        done = subprocess.run(
            ["mono", program, *map(str, arguments)], capture_output=True, text=True, check=False,
            cwd=folder, env=os.environ | {"LD_LIBRARY_PATH": str(folder)},
        )  # fmt: skip
        assert not done.returncode, done.stdout + done.stderr
        return done.stdout

    return ran


@pytest.mark.parametrize("name", ["compact", "spline", "network", "torus"])
def test_in_csharp_the_answers_have_the_same_bits(name, build, files, tmp_path):
    field = NativeField(files[name])
    turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    placed = Placed(field, turned, np.array([0.01, 0.02, 0.03]), 0.05, 400.0)
    # first a way around and into the object, in metres, for the probe
    turn = np.linspace(0, 40, 2000)
    way = np.stack([np.cos(turn), np.sin(turn), 0.2 * np.cos(3 * turn)], axis=1)
    way = field.frame.to_mesh(way * np.linspace(1.6, 0.3, 2000)[:, None])
    points = points_for(field, 4000)
    points[:2000] = 0.05 * way @ turned.T + placed.translation
    asked, told = tmp_path / "points", tmp_path / "answers"
    points.tofile(asked)
    out = build(PROGRAM, files[name], asked, told)
    assert "missing.pandis: the file is missing or cannot be read" in out
    held, count, wanted = told.read_bytes(), len(points), field.query(points)
    sizes = np.cumsum([48, 8 * count, 24 * count, count])
    bounds, distance, normal, flag, felt = np.split(np.frombuffer(held, np.uint8), sizes)
    assert np.array_equal(bounds.view("<f8"), np.concatenate(field.bounds))
    assert np.array_equal(distance.view("<f8"), wanted.distance)
    assert np.array_equal(normal.view("<f8").reshape(-1, 3), wanted.normal)
    assert np.array_equal(flag, wanted.flag)
    contact = NativeContact(placed, 0.001, Material(0.4, 0.3, 0, 0))
    touch = contact.follow(points[:2000], 1e-3)
    felt = np.frombuffer(felt.tobytes(), "<f8").reshape(-1, 6)
    assert np.array_equal(felt[:, :3], touch.force)
    assert np.array_equal(felt[:, 3:], touch.proxy)
    assert touch.force.any(axis=1).sum() > 20


def test_a_thread_renders_a_probe_and_ends_with_no_force(build, files):
    """Pressed down to the largest force; and when the device fails, zero, and the reason."""
    whole, failed = build(THREADS, files["sphere"]).split("\n")[:2]
    ticks, largest, last, seen, kept, why = whole.split(maxsplit=5)
    assert int(ticks) >= 400
    assert float(largest) == pytest.approx(3.0)
    assert float(seen) == pytest.approx(3.0)
    assert float(last) == 0
    assert float(kept) == pytest.approx(1.0, abs=1e-6)
    assert why == "whole"
    ticks, _, last, _, _, why = failed.split(maxsplit=5)
    assert int(ticks) == 100
    assert float(last) == 0
    assert why == "unplugged"


def test_the_program_of_the_page_compiles(build, files):
    page = (ROOT / "docs/csharp.md").read_text(encoding="utf-8")
    (text,) = re.findall("```csharp\n(.*?)```", page, re.S)
    text = text.replace("results/bunny/export/compact-auto.pandis", str(files["compact"]))
    assert "N" in build(text)
