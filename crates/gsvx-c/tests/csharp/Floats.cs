// floats STREAM: the planar arrays of each chunk of the finest level, given in parts, to standard output.

using System;
using System.IO;
using Gsvx;

internal static class Floats
{
    private static readonly SplatArray[] Arrays =
    {
        SplatArray.Means, SplatArray.Rotations, SplatArray.LogScales, SplatArray.OpacityLogits, SplatArray.Sh,
    };

    private static void Main(string[] arguments)
    {
        var file = File.ReadAllBytes(arguments[0]);
        using (var stream = new GsvxStream())
        using (var output = Console.OpenStandardOutput())
        {
            Fetch(stream, file, 0, 0);
            var degree = stream.Info.ShDegree;
            foreach (var chunk in stream.ChunksOfLevel(0))
            {
                Fetch(stream, file, chunk, degree + 1);
                var count = stream.Decode(chunk, degree + 1);
                stream.Forget(chunk);
                foreach (var array in Arrays) Write(stream, array, count, degree, output);
            }
            Refuse(stream);
        }
        Encode(file);
    }

    private static void Write(GsvxStream stream, SplatArray array, int count, uint degree, System.IO.Stream output)
    {
        var bytes = new byte[count * GsvxStream.Stride(array, degree)];
        stream.Copy<byte>(array, bytes);
        output.Write(bytes, 0, bytes.Length);
    }

    private static void Fetch(GsvxStream stream, byte[] file, ulong chunk, uint layers)
    {
        for (var range = stream.Needs(chunk, layers); range.Begin < range.End; range = stream.Needs(chunk, layers))
        {
            var end = (int)Math.Min(range.End, (ulong)file.Length);
            stream.Give(range.Begin, file.AsSpan((int)range.Begin, end - (int)range.Begin));
        }
    }

    private static void Refuse(GsvxStream stream)
    {
        try
        {
            stream.Decode(1000, 1);
        }
        catch (GsvxException error)
        {
            if (error.Status == Status.Argument && error.Message.StartsWith("chunk is 1000")) return;
        }
        throw new Exception("chunk 1000 is decoded");
    }

    // What a model encodes to can be opened.
    private static void Encode(byte[] file)
    {
        var model = new Model
        {
            Axes = Axes.Unity, Means = new float[3], Rotations = new float[] { 1, 0, 0, 0 },
            LogScales = new float[3], OpacityLogits = new float[1], Sh = new float[3],
        };
        using (var stream = new GsvxStream())
        {
            stream.Give(0, model.Encode(60));
            if (stream.Info.Gaussians != 1) throw new Exception("not one Gaussian");
        }
    }
}
