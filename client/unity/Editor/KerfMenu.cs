using UnityEditor;
using UnityEngine;

namespace Kerf.Unity
{
    /// <summary>GameObject > Kerf: what a scene needs, ready to be moved about. Runtime/Prefabs/Kerf.prefab is the same.</summary>
    public static class KerfMenu
    {
        /// <summary>A session of the liver, and a blade above it that goes where its object is moved.</summary>
        [MenuItem("GameObject/Kerf/Session with a blade", false, 10)]
        public static void AddSession()
        {
            var session = new GameObject("Kerf", typeof(KerfSession));
            var blade = new GameObject("Blade", typeof(KerfTool));
            blade.transform.SetParent(session.transform, false);
            blade.transform.localPosition = new Vector3(0, 0.2f, 0);
            blade.GetComponent<KerfTool>().session = session.GetComponent<KerfSession>();
            var shown = GameObject.CreatePrimitive(PrimitiveType.Cube);
            Object.DestroyImmediate(shown.GetComponent<Collider>());
            shown.AddComponent<KerfMaterial>();
            // The cube's lower edge is the blade's.
            shown.transform.SetParent(blade.transform, false);
            shown.transform.localPosition = new Vector3(0, 0.015f, 0);
            shown.transform.localScale = new Vector3(0.06f, 0.03f, 0.001f);
            Undo.RegisterCreatedObjectUndo(session, "Kerf session");
            Selection.activeGameObject = session;
        }
    }
}
