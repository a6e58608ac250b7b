using UnityEngine;

namespace Gsvx
{
    /// <summary>A scene in Unity's coordinates: left-handed, y up. All arrays have the same order.</summary>
    public sealed class GsvxScene : ScriptableObject
    {
        public Bounds bounds;
        public Vector3[] positions;
        public Quaternion[] rotations;
        /// <summary>Standard deviations along the axes of each Gaussian.</summary>
        public Vector3[] scales;
        /// <summary>Base colour in sRGB, which may be outside 0 to 1, and the opacity.</summary>
        public Color[] colours;
        /// <summary>0 to 3.</summary>
        public int shDegree;
        /// <summary>For each Gaussian the (shDegree + 1)^2 - 1 coefficients above degree 0: red, green, blue.</summary>
        public Vector3[] sh;
    }
}
