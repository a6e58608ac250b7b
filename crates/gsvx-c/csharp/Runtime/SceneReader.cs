using System;
using System.Collections.Generic;
using UnityEngine;

namespace Gsvx
{
    /// <summary>Makes a scene of a stream.</summary>
    public sealed class SceneReader
    {
        // A count is a claim until its chunk is decoded, so memory grows with what is decoded.
        private readonly List<Vector3> positions = new List<Vector3>();
        private readonly List<Quaternion> rotations = new List<Quaternion>();
        private readonly List<Vector3> scales = new List<Vector3>();
        private readonly List<Color> colours = new List<Color>();
        private readonly List<Vector3> sh = new List<Vector3>();

        /// <summary>Reads one level of detail of a stream in memory into a scene; 0 is the finest.</summary>
        public static void Read(ReadOnlySpan<byte> bytes, uint level, GsvxScene scene)
        {
            using (var stream = new GsvxStream(Axes.Unity))
            {
                stream.Give(0, bytes);
                var info = stream.Info;
                var reader = new SceneReader();
                foreach (var chunk in stream.ChunksOfLevel(level))
                    reader.Append(stream, stream.Decode(chunk, info.ShDegree + 1), info.ShDegree);
                reader.Fill(scene, info);
            }
        }

        private void Append(GsvxStream stream, int count, uint shDegree)
        {
            positions.AddRange(Copied<Vector3>(stream, SplatArray.Means, count));
            scales.AddRange(Copied<Vector3>(stream, SplatArray.Scales, count));
            colours.AddRange(Copied<Color>(stream, SplatArray.Colours, count));
            foreach (var q in Copied<Wxyz>(stream, SplatArray.Rotations, count))
            {
                var length = Mathf.Sqrt(q.W * q.W + q.X * q.X + q.Y * q.Y + q.Z * q.Z);
                rotations.Add(new Quaternion(q.X / length, q.Y / length, q.Z / length, q.W / length));
            }
            var coefficients = (int)((shDegree + 1) * (shDegree + 1));
            var all = Copied<Vector3>(stream, SplatArray.Sh, count * coefficients);
            for (var i = 0; i < all.Length; i++)
                if (i % coefficients != 0) sh.Add(all[i]);
        }

        private static T[] Copied<T>(GsvxStream stream, SplatArray array, int length) where T : struct
        {
            var values = new T[length];
            stream.Copy<T>(array, values);
            return values;
        }

        private void Fill(GsvxScene scene, StreamInfo info)
        {
            scene.positions = positions.ToArray();
            scene.rotations = rotations.ToArray();
            scene.scales = scales.ToArray();
            scene.colours = colours.ToArray();
            scene.sh = sh.ToArray();
            scene.shDegree = (int)info.ShDegree;
            if (info.Gaussians == 0) return;
            var low = new Vector3(info.LowX, info.LowY, info.LowZ);
            var high = new Vector3(info.HighX, info.HighY, info.HighZ);
            scene.bounds = new Bounds((low + high) * 0.5f, high - low);
        }

        // A rotation as the library writes it.
        private struct Wxyz
        {
#pragma warning disable 0649
            public float W, X, Y, Z;
#pragma warning restore 0649
        }
    }
}
