// Fields of .pandis files in C#: distances, a probe that is kept out, and a thread that renders it.
//
// Needs libpandis (pandis.c beside this file) where the runtime finds native libraries: in Unity under
// Assets/Plugins, elsewhere beside the program. Works with .NET, Mono and Unity; C# 7 or later.

using System;
using System.Diagnostics;
using System.Runtime.InteropServices;
using System.Threading;

namespace Pandis
{
    /// <summary>Something went wrong: a file that cannot be opened, or a place that is none.</summary>
    public sealed class PandisException : Exception
    {
        public PandisException(string message) : base(message) { }
    }

    /// <summary>Three numbers in double precision: a place, a direction or a force.</summary>
    public struct Vector
    {
        public double X, Y, Z;

        public Vector(double x, double y, double z) { X = x; Y = y; Z = z; }

        public double Length { get { return Math.Sqrt(X * X + Y * Y + Z * Z); } }

        public bool IsFinite { get { return !double.IsNaN(X + Y + Z) && !double.IsInfinity(X + Y + Z); } }
    }

    /// <summary>A field of an object. Any number of threads may ask it.</summary>
    public sealed class Field : IDisposable
    {
        internal readonly FieldHandle Handle;

        /// <summary>Open a file.</summary>
        /// <exception cref="PandisException">It cannot be read, is damaged, or of a later version.</exception>
        public Field(string path)
        {
            IntPtr error;
            Handle = Native.pandis_field_open(Native.Utf8(path), out error);
            if (Handle.IsInvalid) throw new PandisException(path + ": " + Marshal.PtrToStringAnsi(error));
        }

        /// <summary>The box in which the surface lies, mesh units: six numbers, lowest corner first.</summary>
        public double[] Bounds
        {
            get
            {
                double[] low = new double[3], high = new double[3], both = new double[6];
                Native.pandis_field_bounds(Handle, low, high);
                low.CopyTo(both, 0);
                high.CopyTo(both, 3);
                return both;
            }
        }

        /// <summary>Distances, normals and flags at points (x, y, z one after the other), mesh units.</summary>
        public void Query(double[] points, double[] distances, double[] normals, byte[] flags)
        {
            int count = points.Length / 3;
            if (points.Length % 3 != 0 || distances.Length < count || normals.Length < 3 * count || flags.Length < count)
                throw new ArgumentException("three numbers for each point and normal, one distance and one flag");
            Native.pandis_field_query(Handle, points, count, distances, normals, flags);
        }

        /// <summary>Let go of the file; probes that ask it keep it open as long as they are.</summary>
        public void Dispose() { Handle.Dispose(); }
    }

    /// <summary>A probe that is kept out of an object. One thread at a time may use it.</summary>
    public sealed class Probe : IDisposable
    {
        readonly ProbeHandle handle;
        readonly double[] place = new double[3], force = new double[3], proxy = new double[3];

        /// <param name="field">Of the object.</param>
        /// <param name="rotation">Nine numbers, by rows: a point p of the mesh lies at scale · rotation · p + translation.</param>
        /// <param name="translation">Three numbers, metres.</param>
        /// <param name="scale">Metres of a unit of the mesh.</param>
        /// <param name="stiffness">N/m.</param>
        /// <param name="radius">Of the probe, metres.</param>
        /// <exception cref="PandisException">The object lies nowhere, or is a grid of forces.</exception>
        public Probe(Field field, double[] rotation, double[] translation, double scale, double stiffness, double radius)
        {
            CheckPlace(rotation, translation);
            IntPtr error;
            handle = Native.pandis_probe_open(field.Handle, rotation, translation, scale, stiffness, radius, out error);
            if (handle.IsInvalid) throw new PandisException(Marshal.PtrToStringAnsi(error));
            handle.Keep(field.Handle);
        }

        /// <summary>The flag of the last tick: 0 and 1 are answers, 2 is none, as of pandis.h.</summary>
        public int Flag { get; private set; }

        /// <summary>Friction coefficients, up to which the probe sticks, and when it slides; not more.</summary>
        public void Friction(double sticking, double sliding)
        {
            Native.pandis_probe_friction(handle, sticking, sliding);
        }

        /// <summary>Put the object elsewhere.</summary>
        /// <exception cref="PandisException">The rotation is none, or a number is not finite: it stays where it is.</exception>
        public void Move(double[] rotation, double[] translation)
        {
            CheckPlace(rotation, translation);
            if (Native.pandis_probe_move(handle, rotation, translation) == 0)
                throw new PandisException("the object lies nowhere: its rotation is none, or a number is not finite");
        }

        /// <summary>A tick: the force on the hand, N, at a place of the probe. The first must be outside.</summary>
        /// <param name="at">Metres.</param>
        /// <param name="seconds">Since the last tick.</param>
        /// <param name="surface">Where the probe is kept.</param>
        public Vector Tick(Vector at, double seconds, out Vector surface)
        {
            place[0] = at.X;
            place[1] = at.Y;
            place[2] = at.Z;
            Flag = Native.pandis_probe_tick(handle, place, seconds, force, proxy);
            surface = new Vector(proxy[0], proxy[1], proxy[2]);
            return new Vector(force[0], force[1], force[2]);
        }

        public void Dispose() { handle.Dispose(); }

        static void CheckPlace(double[] rotation, double[] translation)
        {
            if (rotation.Length != 9 || translation.Length != 3)
                throw new ArgumentException("a rotation of nine numbers, a translation of three");
        }
    }

    /// <summary>
    /// Renders a probe at the rate of a device, on a thread of its own. In Unity: make it in OnEnable, dispose
    /// of it in OnDisable, and read Force and Surface in Update to draw them.
    /// </summary>
    public sealed class HapticThread : IDisposable
    {
        readonly Probe probe;
        readonly Func<Vector> read;
        readonly Action<Vector> write;
        readonly double period, largest;
        readonly Thread thread;
        readonly object gate = new object(), failing = new object();
        volatile bool stopping;
        Vector force, surface;
        long ticks, late;
        Exception failure;

        /// <param name="probe">Not to be used elsewhere as long as the thread runs; but see Move.</param>
        /// <param name="read">Where the device is, metres.</param>
        /// <param name="write">What its motors are given, N: at the end, and after a failure, zero.</param>
        /// <param name="rate">Ticks per second.</param>
        /// <param name="largest">No force is larger, N.</param>
        public HapticThread(Probe probe, Func<Vector> read, Action<Vector> write, double rate, double largest)
        {
            if (!(rate >= 1 && rate <= 20000) || !(largest > 0)) throw new ArgumentException("a rate from 1 to 20,000 Hz, a force above zero");
            this.probe = probe;
            this.read = read;
            this.write = write;
            this.largest = largest;
            period = 1 / rate;
            thread = new Thread(Run) { IsBackground = true, Priority = ThreadPriority.Highest, Name = "pandis" };
        }

        /// <summary>The last force on the hand, N.</summary>
        public Vector Force { get { lock (gate) return force; } }

        /// <summary>Where the probe was kept at the last tick, metres.</summary>
        public Vector Surface { get { lock (gate) return surface; } }

        /// <summary>Ticks so far.</summary>
        public long Ticks { get { return Interlocked.Read(ref ticks); } }

        /// <summary>Ticks that began more than a period late.</summary>
        public long Late { get { return Interlocked.Read(ref late); } }

        /// <summary>What ended the thread before it was asked to stop; null if nothing did.</summary>
        public Exception Failure { get { lock (failing) return failure; } }

        public void Start() { thread.Start(); }

        /// <summary>Put the object elsewhere, between two ticks.</summary>
        public void Move(double[] rotation, double[] translation) { lock (gate) probe.Move(rotation, translation); }

        void Run()
        {
            try
            {
                Stopwatch clock = Stopwatch.StartNew();
                double due = 0;
                while (!stopping)
                {
                    Vector at = read();
                    if (!at.IsFinite) throw new PandisException("the device says that it is nowhere");
                    Vector given, kept;
                    lock (gate)
                    {
                        given = probe.Tick(at, period, out kept);
                        if (probe.Flag == 2) throw new PandisException("the field has no answer there");
                        double size = given.Length, share = size > largest ? largest / size : 1;
                        given = new Vector(share * given.X, share * given.Y, share * given.Z);
                        if (!given.IsFinite) throw new PandisException("the force is no number");
                        force = given;
                        surface = kept;
                    }
                    write(given);
                    Interlocked.Increment(ref ticks);
                    due += period;
                    double now = clock.Elapsed.TotalSeconds;
                    if (now > due + period)
                    {
                        Interlocked.Increment(ref late);
                        due = now; // who is late does not catch up
                    }
                    if (due - now > 2e-3) Thread.Sleep((int)(1e3 * (due - now)) - 1);
                    while (clock.Elapsed.TotalSeconds < due) Thread.SpinWait(20);
                }
            }
            catch (Exception error)
            {
                lock (failing) failure = error;
            }
            finally
            {
                try { write(new Vector()); }
                catch (Exception error) { lock (failing) failure = failure ?? error; }
                lock (gate) force = new Vector();
            }
        }

        /// <summary>Stop, with a last force of zero; also if the device has not come back for a second.</summary>
        public void Dispose()
        {
            stopping = true;
            if (!thread.IsAlive || thread.Join(1000)) return;
            lock (failing) failure = failure ?? new TimeoutException("the device has not come back");
            write(new Vector());
        }
    }

    /// <summary>A field of the library, open as long as anything uses it.</summary>
    sealed class FieldHandle : SafeHandle
    {
        FieldHandle() : base(IntPtr.Zero, true) { }

        public override bool IsInvalid { get { return handle == IntPtr.Zero; } }

        protected override bool ReleaseHandle()
        {
            Native.pandis_field_close(handle);
            return true;
        }
    }

    /// <summary>A probe of the library, which keeps its field open.</summary>
    sealed class ProbeHandle : SafeHandle
    {
        FieldHandle field;

        ProbeHandle() : base(IntPtr.Zero, true) { }

        public override bool IsInvalid { get { return handle == IntPtr.Zero; } }

        internal void Keep(FieldHandle kept)
        {
            bool done = false;
            kept.DangerousAddRef(ref done);
            field = kept;
        }

        protected override bool ReleaseHandle()
        {
            Native.pandis_probe_close(handle);
            if (field != null) field.DangerousRelease();
            return true;
        }
    }

    static class Native
    {
        const string Library = "pandis";

        internal static byte[] Utf8(string text) { return System.Text.Encoding.UTF8.GetBytes(text + "\0"); }

        [DllImport(Library)] internal static extern FieldHandle pandis_field_open(byte[] path, out IntPtr error);
        [DllImport(Library)] internal static extern void pandis_field_close(IntPtr field);
        [DllImport(Library)] internal static extern void pandis_field_bounds(FieldHandle field, [Out] double[] low, [Out] double[] high);
        [DllImport(Library)] internal static extern void pandis_field_query(FieldHandle field, double[] points, int count, [Out] double[] distances, [Out] double[] normals, [Out] byte[] flags);
        [DllImport(Library)] internal static extern ProbeHandle pandis_probe_open(FieldHandle field, double[] rotation, double[] translation, double scale, double stiffness, double radius, out IntPtr error);
        [DllImport(Library)] internal static extern void pandis_probe_close(IntPtr probe);
        [DllImport(Library)] internal static extern void pandis_probe_friction(ProbeHandle probe, double sticking, double sliding);
        [DllImport(Library)] internal static extern int pandis_probe_move(ProbeHandle probe, double[] rotation, double[] translation);
        [DllImport(Library)] internal static extern int pandis_probe_tick(ProbeHandle probe, double[] position, double dt, [Out] double[] force, [Out] double[] proxy);
    }
}
