// The C interface of gsvx in C#. The header gsvx.h says what each function does, with shapes, units and thread rules.
// Compiles as C# 7 with unsafe code, in Unity and without it.

using System;
using System.Collections.Generic;
using System.Runtime.InteropServices;
using System.Text;

namespace Gsvx
{
    /// <summary>What became of a call: gsvx_status.</summary>
    public enum Status : uint { Ok, NotGsvx, Version, Truncated, Damaged, Limit, Argument, Buffer, Model, Internal }

    /// <summary>Coordinate axes: gsvx_axes.</summary>
    public enum Axes : uint { Stored, YUp, Unity, Unreal }

    /// <summary>Arrays of a decoded chunk: gsvx_array has their shapes.</summary>
    public enum SplatArray : uint
    {
        Means, Rotations, LogScales, OpacityLogits, Sh, Scales, Colours, Covariances, ColourBytes,
        ShBytes1, ShBytes2, ShBytes3, PackedA, PackedB, PackedSh1, PackedSh2, PackedSh3a, PackedSh3b,
    }

    /// <summary>What holds for the whole stream: gsvx_info.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct StreamInfo
    {
        public ulong Gaussians, Bytes, Chunks;
        public uint Levels, ShDegree;
        public float LowX, LowY, LowZ, HighX, HighY, HighZ;
        /// <summary>1 if opacity is to be compensated for the blur, otherwise 0.</summary>
        public uint Antialiased;
    }

    /// <summary>What the index knows of a chunk: gsvx_chunk.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct ChunkInfo
    {
        public ulong Gaussians, FinerBegin, FinerEnd;
        public float LowX, LowY, LowZ, HighX, HighY, HighZ;
        public uint Level, Exact, Layers;
    }

    /// <summary>Bytes of the stream from Begin to before End: gsvx_range.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct ByteRange
    {
        public ulong Begin, End;
    }

    /// <summary>A call that failed, and why.</summary>
    public sealed class GsvxException : Exception
    {
        public readonly Status Status;

        public GsvxException(Status status, string message) : base(message)
        {
            Status = status;
        }
    }

    /// <summary>A stream of which bytes are given as they arrive, and one decoded chunk of it.</summary>
    public sealed unsafe class GsvxStream : IDisposable
    {
        private readonly Handle handle;
        // Text for errors. Calls on one stream wait for each other here.
        private readonly byte[] text = new byte[Native.MessageBytes];

        public GsvxStream(Axes axes = Axes.Stored, uint maxShDegree = 3, ulong maxGaussians = 0)
        {
            var coefficients = (maxShDegree + 1) * (maxShDegree + 1);
            var options = new Native.Options { Axes = axes, MaxShCoefficients = coefficients, MaxGaussians = maxGaussians };
            Check(Native.gsvx_open(ref options, out handle, text));
        }

        /// <summary>Gives bytes of the stream that begin at an offset. They are copied.</summary>
        public void Give(ulong offset, ReadOnlySpan<byte> bytes)
        {
            lock (text)
                fixed (byte* first = &MemoryMarshal.GetReference(bytes))
                    Check(Native.gsvx_give(handle, offset, first, (UIntPtr)bytes.Length, text));
        }

        /// <summary>The next bytes to give for the first layers of a chunk; Begin equals End if none is missing.
        /// With 0 layers: for the head.</summary>
        public ByteRange Needs(ulong chunk, uint layers)
        {
            lock (text)
            {
                ByteRange range;
                Check(Native.gsvx_needs(handle, chunk, layers, out range, text));
                return range;
            }
        }

        /// <summary>What holds for the whole stream, once its head has arrived.</summary>
        public StreamInfo Info
        {
            get
            {
                lock (text)
                {
                    StreamInfo info;
                    Check(Native.gsvx_get_info(handle, out info, text));
                    return info;
                }
            }
        }

        /// <summary>What the index knows of a chunk.</summary>
        public ChunkInfo GetChunk(ulong number)
        {
            lock (text)
            {
                ChunkInfo chunk;
                Check(Native.gsvx_get_chunk(handle, number, out chunk, text));
                return chunk;
            }
        }

        /// <summary>The numbers of the chunks that together are one level of detail; 0 is the finest.</summary>
        public IEnumerable<ulong> ChunksOfLevel(uint level)
        {
            for (ulong number = 0, chunks = Info.Chunks; number < chunks; number++)
            {
                var chunk = GetChunk(number);
                if (chunk.Exact != 0 || chunk.Level == level) yield return number;
            }
        }

        /// <summary>Decodes the first layers of a chunk, and returns the number of its Gaussians.</summary>
        public int Decode(ulong chunk, uint layers)
        {
            lock (text)
            {
                ulong gaussians;
                Check(Native.gsvx_decode(handle, chunk, layers, out gaussians, text));
                return checked((int)gaussians);
            }
        }

        /// <summary>Copies an array of the decoded chunk.</summary>
        public void Copy<T>(SplatArray array, Span<T> to) where T : struct
        {
            var bytes = MemoryMarshal.AsBytes(to);
            lock (text)
                fixed (byte* first = &MemoryMarshal.GetReference(bytes))
                    Check(Native.gsvx_copy(handle, array, first, (UIntPtr)bytes.Length, text));
        }

        /// <summary>Bytes for each Gaussian in an array of a stream of an SH degree.</summary>
        public static int Stride(SplatArray array, uint shDegree)
        {
            return (int)Native.gsvx_stride(array, shDegree);
        }

        /// <summary>Frees the bytes that were given of a chunk.</summary>
        public void Forget(ulong chunk)
        {
            lock (text) Check(Native.gsvx_forget(handle, chunk, text));
        }

        public void Dispose()
        {
            handle.Dispose();
        }

        private void Check(Status status)
        {
            if (status != Status.Ok) throw new GsvxException(status, Native.Text(text));
        }
    }

    /// <summary>A model in the parametrisation of training: gsvx_model has the shapes.</summary>
    public sealed class Model
    {
        public Axes Axes;
        public uint ShDegree;
        public bool Antialiased;
        public float[] Means, Rotations, LogScales, OpacityLogits, Sh;

        /// <summary>Encodes the model: for at most so many bytes, or with a quality from 0 to 100.</summary>
        public unsafe byte[] Encode(float quality = 80, ulong maxBytes = 0)
        {
            var count = OpacityLogits.Length;
            var coefficients = 3 * (ShDegree + 1) * (ShDegree + 1);
            if (Means.Length != 3 * count || Rotations.Length != 4 * count || LogScales.Length != 3 * count
                || Sh.Length != coefficients * count)
                throw new ArgumentException("the arrays are not of as many Gaussians");
            var options = new Native.EncodeOptions { MaxBytes = maxBytes, Quality = quality };
            var text = new byte[Native.MessageBytes];
            byte* bytes;
            UIntPtr size;
            fixed (float* means = Means, rotations = Rotations, logScales = LogScales, logits = OpacityLogits, sh = Sh)
            {
                var model = new Native.Model
                {
                    Gaussians = (ulong)count, Means = means, Rotations = rotations, LogScales = logScales,
                    OpacityLogits = logits, Sh = sh, ShDegree = ShDegree, Axes = Axes,
                    Antialiased = Antialiased ? 1u : 0u,
                };
                var status = Native.gsvx_encode(ref model, ref options, out bytes, out size, text);
                if (status != Status.Ok) throw new GsvxException(status, Native.Text(text));
            }
            try
            {
                var stream = new byte[checked((int)size)];
                Marshal.Copy((IntPtr)bytes, stream, 0, stream.Length);
                return stream;
            }
            finally
            {
                Native.gsvx_free(bytes, size);
            }
        }
    }

    /// <summary>Closes the stream when nobody uses it any more, not even a call that is under way.</summary>
    internal sealed class Handle : SafeHandle
    {
        public Handle() : base(IntPtr.Zero, true)
        {
        }

        public override bool IsInvalid
        {
            get { return handle == IntPtr.Zero; }
        }

        protected override bool ReleaseHandle()
        {
            Native.gsvx_close(handle);
            return true;
        }
    }

    internal static unsafe class Native
    {
#if UNITY_IOS && !UNITY_EDITOR
        private const string Library = "__Internal";
#else
        private const string Library = "gsvx";
#endif
        internal const int MessageBytes = 512;

        [StructLayout(LayoutKind.Sequential)]
        internal struct Options
        {
            public Axes Axes;
            public uint MaxShCoefficients;
            public ulong MaxGaussians;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct EncodeOptions
        {
            public ulong MaxBytes;
            public float Quality;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct Model
        {
            public ulong Gaussians;
            public float* Means, Rotations, LogScales, OpacityLogits, Sh;
            public uint ShDegree;
            public Axes Axes;
            public uint Antialiased;
        }

        internal static string Text(byte[] message)
        {
            return Encoding.UTF8.GetString(message, 0, Array.IndexOf(message, (byte)0));
        }

        [DllImport(Library, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status gsvx_open(ref Options options, out Handle stream, [Out] byte[] message);

        [DllImport(Library, CallingConvention = CallingConvention.Cdecl)]
        internal static extern void gsvx_close(IntPtr stream);

        [DllImport(Library, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status gsvx_give(Handle stream, ulong offset, byte* bytes, UIntPtr size, [Out] byte[] message);

        [DllImport(Library, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status gsvx_needs(Handle stream, ulong chunk, uint layers, out ByteRange range, [Out] byte[] message);

        [DllImport(Library, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status gsvx_get_info(Handle stream, out StreamInfo info, [Out] byte[] message);

        [DllImport(Library, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status gsvx_get_chunk(Handle stream, ulong chunk, out ChunkInfo entry, [Out] byte[] message);

        [DllImport(Library, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status gsvx_decode(Handle stream, ulong chunk, uint layers, out ulong gaussians, [Out] byte[] message);

        [DllImport(Library, CallingConvention = CallingConvention.Cdecl)]
        internal static extern UIntPtr gsvx_stride(SplatArray array, uint shDegree);

        [DllImport(Library, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status gsvx_copy(Handle stream, SplatArray array, void* to, UIntPtr size, [Out] byte[] message);

        [DllImport(Library, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status gsvx_forget(Handle stream, ulong chunk, [Out] byte[] message);

        [DllImport(Library, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status gsvx_encode(ref Model model, ref EncodeOptions options, out byte* bytes, out UIntPtr size, [Out] byte[] message);

        [DllImport(Library, CallingConvention = CallingConvention.Cdecl)]
        internal static extern void gsvx_free(byte* bytes, UIntPtr size);
    }
}
