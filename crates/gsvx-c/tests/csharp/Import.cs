// import STREAM LEVEL: what the importer makes of a stream: positions, rotations, scales, colours and SH coefficients as
// floats, to standard output; an error to standard error.

using System;
using System.Collections.Generic;
using System.Runtime.InteropServices;
using Gsvx;
using Gsvx.Editor;
using UnityEditor.AssetImporters;

internal static class Import
{
    private static int Main(string[] arguments)
    {
        var context = new AssetImportContext { assetPath = arguments[0] };
        new GsvxImporter { level = uint.Parse(arguments[1]) }.OnImportAsset(context);
        foreach (var error in context.Errors) Console.Error.WriteLine(error);
        if (context.Errors.Count > 0) return 3;
        var scene = (GsvxScene)context.Main;
        using (var output = Console.OpenStandardOutput())
        {
            Write(scene.positions, output);
            Write(scene.rotations, output);
            Write(scene.scales, output);
            Write(scene.colours, output);
            Write(scene.sh, output);
            Write(new[] { scene.bounds }, output);
        }
        return 0;
    }

    private static void Write<T>(T[] values, System.IO.Stream output) where T : struct
    {
        var bytes = MemoryMarshal.AsBytes<T>(values).ToArray();
        output.Write(bytes, 0, bytes.Length);
    }
}
