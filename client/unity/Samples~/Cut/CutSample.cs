using Kerf.Unity;
using UnityEngine;
#if ENABLE_INPUT_SYSTEM && !ENABLE_LEGACY_INPUT_MANAGER
using UnityEngine.InputSystem;
#endif

/// <summary>Put this on an empty object in an empty scene and press play, with `make demo`'s server running: a liver, and a
/// blade that follows the mouse. The wheel lowers it, the force is written beside it.</summary>
public sealed class CutSample : MonoBehaviour
{
    public string address = "http://127.0.0.1:50051";
    public string sceneName = "liver";

    /// <summary>A hand's speed: what the blade meets is cut in a sweep, however the mouse jumps.</summary>
    const float SpeedMPerS = 0.15f;
    const float NotchM = 0.01f;

    KerfSession session;
    KerfTool blade;
    Camera eye;
    float heightM = 0.1f;
    Vector3 wanted = new Vector3(0, 0.1f, 0);

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
        session.sceneName = sceneName;
        var shown = GameObject.CreatePrimitive(PrimitiveType.Cube);
        Destroy(shown.GetComponent<Collider>());
        shown.GetComponent<MeshRenderer>().sharedMaterial = KerfMaterials.Load("Steel");
        shown.transform.localScale = new Vector3(0.06f, 0.03f, 0.001f);
        var handle = new GameObject("Blade");
        handle.transform.position = wanted;
        // The cube's lower edge is the blade's.
        shown.transform.SetParent(handle.transform, false);
        shown.transform.localPosition = new Vector3(0, 0.015f, 0);
        blade = handle.AddComponent<KerfTool>();
        blade.session = session;
    }

    void Update()
    {
        heightM = Mathf.Clamp(heightM - NotchM * Wheel(), -0.05f, 0.2f);
        var ray = eye.ScreenPointToRay(Pointer());
        // The level plane at that height.
        if (new Plane(Vector3.up, heightM * Vector3.up).Raycast(ray, out var along)) wanted = ray.GetPoint(along);
        blade.transform.position = Vector3.MoveTowards(blade.transform.position, wanted, SpeedMPerS * Time.deltaTime);
    }

    void OnGUI()
    {
        var making = session.Making;
        var said = making != null ? string.Format("the scene is made: {0:0} %", 100 * making.Share)
            : session.Trouble ?? string.Format("{0:0.00} N, height {1:0} mm", blade.ForceN.magnitude, heightM * 1e3f);
        GUI.Label(new Rect(20, 20, 900, 40), said);
    }

#if ENABLE_INPUT_SYSTEM && !ENABLE_LEGACY_INPUT_MANAGER
    static Vector3 Pointer() => Mouse.current == null ? Vector3.zero : (Vector3)Mouse.current.position.ReadValue();

    // It counts a notch as 120 on Windows, and as 1 elsewhere.
    static float Wheel() => Mouse.current == null ? 0 : Mathf.Clamp(Mouse.current.scroll.ReadValue().y, -1, 1);
#else
    static Vector3 Pointer() => Input.mousePosition;

    static float Wheel() => Input.mouseScrollDelta.y;
#endif
}
