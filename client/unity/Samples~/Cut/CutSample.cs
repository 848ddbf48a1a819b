using Kerf.Unity;
using UnityEngine;

/// <summary>Put this on an empty object in an empty scene and press play, with `make demo`'s server running: a liver, and a
/// blade that follows the mouse. The wheel lowers it, the force is written beside it.</summary>
public sealed class CutSample : MonoBehaviour
{
    public string address = "http://127.0.0.1:50051";

    KerfSession session;
    KerfTool blade;
    Camera eye;
    float heightM = 0.1f;

    void Start()
    {
        eye = new GameObject("Eye", typeof(Camera)).GetComponent<Camera>();
        eye.transform.position = new Vector3(0, 0.35f, -0.35f);
        eye.transform.LookAt(Vector3.zero);
        eye.nearClipPlane = 0.01f;
        var light = new GameObject("Light", typeof(Light)).GetComponent<Light>();
        light.type = LightType.Directional;
        light.transform.rotation = Quaternion.Euler(50, 30, 0);

        session = gameObject.AddComponent<KerfSession>();
        session.address = address;
        var shown = GameObject.CreatePrimitive(PrimitiveType.Cube);
        Destroy(shown.GetComponent<Collider>());
        shown.transform.localScale = new Vector3(0.06f, 0.03f, 0.001f);
        var handle = new GameObject("Blade");
        // The cube's lower edge is the blade's.
        shown.transform.SetParent(handle.transform, false);
        shown.transform.localPosition = new Vector3(0, 0.015f, 0);
        blade = handle.AddComponent<KerfTool>();
        blade.session = session;
    }

    void Update()
    {
        heightM = Mathf.Clamp(heightM - 0.01f * Input.mouseScrollDelta.y, -0.05f, 0.2f);
        var ray = eye.ScreenPointToRay(Input.mousePosition);
        if (new Plane(Vector3.up, -heightM * Vector3.up).Raycast(ray, out var along)) blade.transform.position = ray.GetPoint(along);
    }

    void OnGUI()
    {
        var said = session.Trouble ?? string.Format("{0:0.00} N, height {1:0} mm", blade.ForceN.magnitude, heightM * 1e3f);
        GUI.Label(new Rect(20, 20, 900, 40), said);
    }
}
