using System.IO;
using UnityEditor.AssetImporters;
using UnityEngine;

namespace Gsvx.Editor
{
    /// <summary>Makes a GsvxScene of each .gsvx file of a project.</summary>
    [ScriptedImporter(1, "gsvx")]
    public sealed class GsvxImporter : ScriptedImporter
    {
        [Tooltip("Level of detail; 0 is the finest.")]
        public uint level;

        public override void OnImportAsset(AssetImportContext context)
        {
            var scene = ScriptableObject.CreateInstance<GsvxScene>();
            try
            {
                SceneReader.Read(File.ReadAllBytes(context.assetPath), level, scene);
            }
            catch (GsvxException error)
            {
                context.LogImportError(context.assetPath + ": " + error.Message);
            }
            context.AddObjectToAsset("scene", scene);
            context.SetMainObject(scene);
        }
    }
}
