// Fields of .pandis files in C#: distances, a probe that is kept out of objects, and a thread that renders it.
//
// Needs libpandis (pandis.c beside this file) where the runtime finds native libraries: in Unity under
// Assets/Plugins, elsewhere beside the program. Works with .NET, Mono and Unity; C# 7 or later.

using System;
using System.Diagnostics;
using System.Runtime.InteropServices;
using System.Threading;

namespace Pandis
{
    /// <summary>A file cannot be opened, a pose is invalid, or a haptic thread failed.</summary>
    public sealed class PandisException : Exception
    {
        public PandisException(string message) : base(message) { }
    }

    /// <summary>Three numbers in double precision: a position, a direction or a force.</summary>
    public struct Vector
    {
        public double X, Y, Z;

        public Vector(double x, double y, double z) { X = x; Y = y; Z = z; }

        public double Length { get { return Math.Sqrt(X * X + Y * Y + Z * Z); } }

        public bool IsFinite { get { return !double.IsNaN(X + Y + Z) && !double.IsInfinity(X + Y + Z); } }
    }

    /// <summary>A field of an object. Any number of threads may query it.</summary>
    public sealed class Field : IDisposable
    {
        internal readonly FieldHandle Handle;

        /// <summary>Open a file.</summary>
        /// <exception cref="PandisException">It cannot be read, is damaged or has a later version.</exception>
        public Field(string path)
        {
            IntPtr error;
            Handle = Native.pandis_field_open(Native.Utf8(path), out error);
            if (Handle.IsInvalid) throw new PandisException(path + ": " + Marshal.PtrToStringAnsi(error));
        }

        /// <summary>A box around the surface, mesh units: six numbers, lowest corner first.</summary>
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

        /// <summary>Distances, normals and flags at points (x, y and z of each in turn), mesh units.</summary>
        public void Query(double[] points, double[] distances, double[] normals, byte[] flags)
        {
            int count = points.Length / 3;
            if (points.Length % 3 != 0 || distances.Length < count || normals.Length < 3 * count || flags.Length < count)
                throw new ArgumentException("each point needs three numbers, and room for a normal, a distance and a flag");
            Native.pandis_field_query(Handle, points, count, distances, normals, flags);
        }

        /// <summary>Release the file; probes of the field keep it open until they are disposed of.</summary>
        public void Dispose() { Handle.Dispose(); }
    }

    /// <summary>A probe that is kept out of an object. One thread at a time may use it.</summary>
    public sealed class Probe : IDisposable
    {
        readonly ProbeHandle handle;
        readonly double[] place = new double[3], force = new double[3], proxy = new double[3];

        /// <param name="field">The object's field.</param>
        /// <param name="rotation">Nine numbers, by rows: a mesh point p is at scale · rotation · p + translation.</param>
        /// <param name="translation">Three numbers, metres.</param>
        /// <param name="scale">Metres per mesh unit.</param>
        /// <param name="stiffness">N/m.</param>
        /// <param name="radius">Radius of the probe, metres.</param>
        /// <exception cref="PandisException">The pose is invalid, or the field is a grid of forces.</exception>
        public Probe(Field field, double[] rotation, double[] translation, double scale, double stiffness, double radius)
        {
            CheckPlace(rotation, translation);
            IntPtr error;
            handle = Native.pandis_probe_open(field.Handle, rotation, translation, scale, stiffness, radius, out error);
            if (handle.IsInvalid) throw new PandisException(Marshal.PtrToStringAnsi(error));
            handle.Keep(field.Handle);
        }

        /// <summary>The flag of the last tick (see pandis.h): 0 and 1 are answers, 2 means none.</summary>
        public int Flag { get; private set; }

        /// <summary>Set the friction coefficients: static, and sliding, which is at most as large.</summary>
        public void Friction(double sticking, double sliding)
        {
            Native.pandis_probe_friction(handle, sticking, sliding);
        }

        /// <summary>Move the object.</summary>
        /// <exception cref="PandisException">The matrix is not a rotation, or a number is not finite: it stays.</exception>
        public void Move(double[] rotation, double[] translation)
        {
            CheckPlace(rotation, translation);
            if (Native.pandis_probe_move(handle, rotation, translation) == 0)
                throw new PandisException("the pose is invalid: the matrix is not a rotation, or a number is not finite");
        }

        /// <summary>Move the probe and return the force on the hand, N. The first position must be outside.</summary>
        /// <param name="at">Position of the probe, metres.</param>
        /// <param name="seconds">Since the last tick.</param>
        /// <param name="surface">Position of the proxy, which stays outside.</param>
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
                throw new ArgumentException("a rotation has nine numbers, a translation three");
        }
    }

    /// <summary>
    /// Renders a probe at the rate of a device, on its own thread. In Unity: create it in OnEnable, dispose
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

        /// <param name="probe">Do not use it elsewhere while the thread runs; to move the object, see Move.</param>
        /// <param name="read">Returns the position of the device, metres.</param>
        /// <param name="write">Sends a force, N, to its motors: at the end, and after a failure, zero.</param>
        /// <param name="rate">Ticks per second.</param>
        /// <param name="largest">Largest force, N; larger ones are reduced to it.</param>
        public HapticThread(Probe probe, Func<Vector> read, Action<Vector> write, double rate, double largest)
        {
            if (!(rate >= 1 && rate <= 20000) || !(largest > 0)) throw new ArgumentException("rate must be from 1 to 20,000 Hz, largest above zero");
            this.probe = probe;
            this.read = read;
            this.write = write;
            this.largest = largest;
            period = 1 / rate;
            thread = new Thread(Run) { IsBackground = true, Priority = ThreadPriority.Highest, Name = "pandis" };
        }

        /// <summary>The last force on the hand, N.</summary>
        public Vector Force { get { lock (gate) return force; } }

        /// <summary>Position of the proxy at the last tick, metres.</summary>
        public Vector Surface { get { lock (gate) return surface; } }

        /// <summary>Ticks so far.</summary>
        public long Ticks { get { return Interlocked.Read(ref ticks); } }

        /// <summary>Ticks that began more than a period late.</summary>
        public long Late { get { return Interlocked.Read(ref late); } }

        /// <summary>The error that ended the thread early; null if there was none.</summary>
        public Exception Failure { get { lock (failing) return failure; } }

        public void Start() { thread.Start(); }

        /// <summary>Move the object between two ticks.</summary>
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
                    if (!at.IsFinite) throw new PandisException("the position of the device is not finite");
                    Vector given, kept;
                    lock (gate)
                    {
                        given = probe.Tick(at, period, out kept);
                        if (probe.Flag == 2) throw new PandisException("the field has no answer there");
                        double size = given.Length, share = size > largest ? largest / size : 1;
                        given = new Vector(share * given.X, share * given.Y, share * given.Z);
                        if (!given.IsFinite) throw new PandisException("the force is not finite");
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
                        due = now; // do not catch up after a late tick
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

        /// <summary>Stop, with a final force of zero, even if the device does not return for a second.</summary>
        public void Dispose()
        {
            stopping = true;
            if (!thread.IsAlive || thread.Join(1000)) return;
            lock (failing) failure = failure ?? new TimeoutException("the device did not return");
            write(new Vector());
        }
    }

    /// <summary>A field of the native library, open as long as anything uses it.</summary>
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

    /// <summary>A probe of the native library, which keeps its field open.</summary>
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
