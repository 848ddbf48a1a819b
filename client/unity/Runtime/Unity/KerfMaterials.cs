using UnityEngine;
using UnityEngine.Rendering;

namespace Kerf.Unity
{
    /// <summary>The package's materials, for the render pipeline that the project has.</summary>
    public static class KerfMaterials
    {
        /// <summary>One of them: "Skin", "CutFace", "Seam" or "Steel".</summary>
        public static Material Load(string name)
        {
            var pipeline = GraphicsSettings.currentRenderPipeline ? "Universal" : "BuiltIn";
            return Resources.Load<Material>("Kerf/" + name + pipeline);
        }
    }
}
