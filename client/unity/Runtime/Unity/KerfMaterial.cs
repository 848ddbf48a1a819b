using UnityEngine;

namespace Kerf.Unity
{
    /// <summary>Draws its object with one of the package's materials, for the render pipeline that the project has: a prefab
    /// names one material alone.</summary>
    [ExecuteAlways, RequireComponent(typeof(MeshRenderer))]
    public sealed class KerfMaterial : MonoBehaviour
    {
        [Tooltip("\"Skin\", \"CutFace\", \"Seam\" or \"Steel\".")]
        public string material = "Steel";

        void OnEnable() => GetComponent<MeshRenderer>().sharedMaterial = KerfMaterials.Load(material);
    }
}
