using System;
using System.IO;
using System.Threading;
using Kerf.Client;
using Kerf.V1;
using UnityEngine;

namespace Kerf.Unity
{
    /// <summary>Starts a session or joins one, and shows its objects as children. One unit of this transform is a metre.</summary>
    public sealed class KerfSession : MonoBehaviour
    {
        /// <summary>How far the lines of cuts stand out from an object, in sizes of it.</summary>
        const float SeamHeight = 0.004f;

        [Tooltip("Address of the server.")]
        public string address = "http://127.0.0.1:50051";

        [Tooltip("File with the token that the server asks for, so that no token stands in the project. Empty: the one that code has set, or none.")]
        public string tokenFile = "";

        [Tooltip("File with the certificate (PEM) of the server, or of the authority that has signed it, where the system does not trust it.")]
        public string certificateFile = "";

        /// <summary>The token that the server asks for, where no file has it. It is not kept with the scene.</summary>
        public string Token { get; set; }

        [Tooltip("A session to join. Empty: a new one of the scene below, which ends with this component.")]
        public string sessionId = "";

        [Tooltip("Scene of a new session, by its name.")]
        public string sceneName = "liver";

        [Tooltip("Steps a second of a new session. 0: what the scene asks for, or fewer, where the server's machine does not keep that up.")]
        public float stepRateHz;

        [Tooltip("States a second.")]
        public float rateHz = 60;

        [Tooltip("Drawn with the outside of the objects; the package's own where it is absent.")]
        public Material skin;

        [Tooltip("Drawn with the walls of cuts; the package's own where it is absent.")]
        public Material cutFace;

        [Tooltip("Drawn with the lines where cuts meet the outside; the package's own where it is absent.")]
        public Material seam;

        /// <summary>Where everything is; null before the first state.</summary>
        public State State { get; private set; }

        /// <summary>Drives this session's tools; null until the session is there.</summary>
        public Driver Driver { get; private set; }

        /// <summary>How far a new session is that is being made; null before and after.</summary>
        public MakingProgress Making => making;

        /// <summary>What is wrong, in words; null while all is well.</summary>
        public string Trouble => failure ?? viewer?.Trouble ?? Driver?.Trouble;

        volatile Server server;
        Viewer viewer;
        KerfTissue[] objects = new KerfTissue[0];
        volatile SessionDescription joined;
        volatile MakingProgress making;
        volatile string failure;
        bool isOwn;

        // Not when it is enabled: who adds this by code sets its fields after that.
        void Update()
        {
            if (server == null) Join();
            if (viewer == null && joined != null) Begin();
            if (viewer != null) viewer.Look(Show);
        }

        void Join()
        {
            if (failure != null) return;
            try
            {
                var token = tokenFile.Length == 0 ? Token : File.ReadAllText(tokenFile).Trim();
                server = new Server(address, token, certificateFile);
            }
            catch (Exception error) when (error is KerfException || error is IOException || error is UnauthorizedAccessException)
            {
                failure = error.Message;
                return;
            }
            isOwn = sessionId.Length == 0;
            var asked = new CreateSessionRequest { SceneName = sceneName, FitStepRate = stepRateHz <= 0 };
            if (stepRateHz > 0) asked.StepRateHz = stepRateHz;
            var (of, id) = (server, sessionId);
            // Building a scene takes a while: not on the thread that draws.
            new Thread(() => Join(of, id, asked)) { IsBackground = true, Name = "kerf-join" }.Start();
        }

        void Join(Server of, string id, CreateSessionRequest asked)
        {
            try
            {
                var description = id.Length == 0 ? of.Create(asked, told => making = told) : of.Describe(id);
                making = null;
                // Disabled meanwhile: nobody is left to end it.
                if (of != server && id.Length == 0) CloseQuietly(of, description.SessionId);
                else joined = description;
            }
            catch (KerfException error)
            {
                making = null;
                if (of == server) failure = error.Message;
            }
        }

        void Begin()
        {
            sessionId = joined.SessionId;
            viewer = new Viewer(server, sessionId, rateHz);
            Driver = new Driver(server, sessionId);
            objects = new KerfTissue[joined.Scene.Objects.Count];
            for (var i = 0; i < objects.Length; i++)
            {
                var of = joined.Scene.Objects[i];
                var child = new GameObject(of.Name, typeof(MeshFilter), typeof(MeshRenderer));
                child.transform.SetParent(transform, false);
                objects[i] = child.AddComponent<KerfTissue>();
                objects[i].SeamHeightM = SeamHeight * (Frames.ToUnity(of.RestMaxM) - Frames.ToUnity(of.RestMinM)).magnitude;
                objects[i].SetMaterials(Own(skin, "Skin"), Own(cutFace, "CutFace"), Own(seam, "Seam"));
            }
        }

        void Show(Replica replica)
        {
            State = replica.State;
            for (var i = 0; i < objects.Length && i < replica.Bodies.Count; i++) objects[i].Show(replica.Bodies[i], replica.StructureCount);
        }

        void OnDisable()
        {
            var last = viewer?.Server ?? server;
            Driver?.Dispose();
            viewer?.Dispose();
            foreach (var shown in objects) Destroy(shown.gameObject);
            objects = new KerfTissue[0];
            if (isOwn && joined != null)
            {
                CloseQuietly(last, joined.SessionId);
                sessionId = "";
            }
            (Driver, viewer, joined, failure, State, server) = (null, null, null, null, null, null);
        }

        static Material Own(Material given, string name)
        {
            return given ? given : KerfMaterials.Load(name);
        }

        static void CloseQuietly(Server server, string sessionId)
        {
            try
            {
                server.Close(sessionId);
            }
            catch (KerfException)
            {
                // It ends by itself when nobody asks for it any more.
            }
        }
    }
}
