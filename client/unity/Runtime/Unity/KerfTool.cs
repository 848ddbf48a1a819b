using Kerf.V1;
using UnityEngine;

namespace Kerf.Unity
{
    /// <summary>Drives a tool of a session to where this transform is: x along the edge, -y the way it cuts.</summary>
    public sealed class KerfTool : MonoBehaviour
    {
        [Tooltip("The session.")]
        public KerfSession session;

        [Tooltip("Which of its tools, from 0.")]
        public int toolId;

        [Tooltip("Fraction of their full opening that its jaws take.")]
        [Range(0, 1)]
        public float opening = 1;

        /// <summary>Force on the tool, N, in Unity's frame.</summary>
        public Vector3 ForceN { get; private set; }

        /// <summary>Length of edge that cuts, m.</summary>
        public float CuttingLengthM { get; private set; }

        void Update()
        {
            var driver = session ? session.Driver : null;
            if (driver == null) return;
            var at = session.transform;
            var position = at.InverseTransformPoint(transform.position);
            var rotation = Quaternion.Inverse(at.rotation) * transform.rotation;
            driver.Move((uint)toolId, Frames.ToScene(position), Frames.ToScene(rotation), opening);
            var contact = driver.ContactOf((uint)toolId);
            if (contact == null) return;
            ForceN = at.TransformDirection(Frames.ToUnity(contact.Wrench.ForceN));
            CuttingLengthM = contact.CuttingLengthM;
        }

        void OnDisable()
        {
            if (session && session.Driver != null) session.Driver.Lift((uint)toolId);
        }
    }
}
