using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Linq;
using System.Reflection;
using System.Text.RegularExpressions;
using UnityEngine;

/// <summary>A prefab as its file says it. What Unity would lose in silence is an exception here: a reference to what is not
/// there, a script that has no class, a value that is no field of it, a field without a value.</summary>
sealed class Prefab
{
    /// <summary>Unity's own things, as the cube's mesh.</summary>
    static readonly string[] BuiltIn = { "0000000000000000e000000000000000", "0000000000000000f000000000000000" };
    static readonly Regex Reference = new Regex(@"\{fileID: (-?\d+)(?:, guid: ([^,}]+), type: \d)?\}");
    static readonly Dictionary<string, Type> Engine = new Dictionary<string, Type>
    {
        ["Transform"] = typeof(Transform),
        ["MeshFilter"] = typeof(MeshFilter),
        ["MeshRenderer"] = typeof(MeshRenderer),
    };

    readonly string path;
    readonly Dictionary<string, string> assets;
    readonly Dictionary<string, Part> parts = new Dictionary<string, Part>();
    readonly Dictionary<string, Component> made = new Dictionary<string, Component>();

    /// <summary>A document of the file: lines of a key and a value, or of a key and some values.</summary>
    sealed class Part
    {
        public string Kind;
        public readonly Dictionary<string, List<string>> Values = new Dictionary<string, List<string>>();

        public string One(string key) => Values[key].Single();
    }

    /// <summary>Reads a prefab of a package, whose folder is given.</summary>
    public Prefab(string package, string path)
    {
        this.path = path;
        assets = Directory.GetFiles(package, "*.meta", SearchOption.AllDirectories)
            .ToDictionary(meta => Regex.Match(File.ReadAllText(meta), @"^guid: (\w+)", RegexOptions.Multiline).Groups[1].Value, meta => meta.Substring(0, meta.Length - 5));
        Part part = null;
        string key = null;
        foreach (var line in File.ReadAllLines(path))
        {
            var begin = Regex.Match(line, @"^--- !u!\d+ &(\d+)$");
            var value = Regex.Match(line, @"^ +(- )?(?:(\w+):)? ?(.*)$");
            if (begin.Success) parts.Add(begin.Groups[1].Value, part = new Part());
            else if (line.StartsWith("%")) continue;
            else if (!line.StartsWith(" ")) part.Kind = line.TrimEnd(':');
            else if (value.Groups[1].Success) part.Values[key].Add(value.Groups[3].Value);
            else part.Values.Add(key = value.Groups[2].Value, value.Groups[3].Value.Length == 0 ? new List<string>() : new List<string> { value.Groups[3].Value });
        }
        foreach (Match found in Reference.Matches(File.ReadAllText(path)))
        {
            var (id, asset) = (found.Groups[1].Value, found.Groups[2].Value);
            if (asset.Length == 0) Need(id == "0" || parts.ContainsKey(id), "nothing has the id " + id);
            else Need(BuiltIn.Contains(asset) || assets.ContainsKey(asset) && File.Exists(assets[asset]), "nothing in the package has the guid " + asset);
        }
    }

    /// <summary>Its objects, as they are in a scene that it is dragged into; the one without a parent.</summary>
    public GameObject Instantiate()
    {
        foreach (var part in parts.Where(part => part.Value.Kind == "GameObject"))
        {
            var of = new GameObject(part.Value.One("m_Name"));
            foreach (var id in part.Value.Values["m_Component"].Select(IdOf))
            {
                Need(IdOf(parts[id].One("m_GameObject")) == part.Key, id + " is of another object");
                made[id] = parts[id].Kind == "Transform" ? of.transform : of.AddComponent(TypeOf(parts[id]));
            }
        }
        Need(parts.All(part => part.Value.Kind == "GameObject" || made.ContainsKey(part.Key)), "a component is of no object");
        GameObject root = null;
        foreach (var id in made.Keys)
        {
            if (made[id] is MonoBehaviour) SetFields(id);
            if (!(made[id] is Transform transform)) continue;
            Place(transform, id);
            if (IdOf(parts[id].One("m_Father")) != "0") continue;
            Need(!root, "two objects have no parent");
            root = transform.gameObject;
        }
        return root;
    }

    void Place(Transform transform, string id)
    {
        var part = parts[id];
        var (at, turned, scale) = (Numbers(part, "m_LocalPosition"), Numbers(part, "m_LocalRotation"), Numbers(part, "m_LocalScale"));
        foreach (var child in part.Values["m_Children"].Where(child => child != "[]").Select(IdOf))
        {
            Need(IdOf(parts[child].One("m_Father")) == id, child + " has another parent");
            ((Transform)made[child]).SetParent(transform, false);
        }
        transform.localPosition = new Vector3(at[0], at[1], at[2]);
        transform.localRotation = new Quaternion(turned[0], turned[1], turned[2], turned[3]);
        transform.localScale = new Vector3(scale[0], scale[1], scale[2]);
    }

    void SetFields(string id)
    {
        var given = parts[id].Values.Where(value => !value.Key.StartsWith("m_")).ToDictionary(value => value.Key, value => value.Value.SingleOrDefault() ?? "");
        var fields = Fields(made[id].GetType()).ToDictionary(field => field.Name);
        var odd = given.Keys.Except(fields.Keys).Concat(fields.Keys.Except(given.Keys)).ToArray();
        Need(odd.Length == 0, made[id].GetType() + " and the prefab differ in " + string.Join(", ", odd));
        foreach (var field in fields.Values) field.SetValue(made[id], Value(field, given[field.Name]));
    }

    object Value(FieldInfo field, string text)
    {
        if (field.FieldType == typeof(string)) return text;
        if (!typeof(UnityEngine.Object).IsAssignableFrom(field.FieldType)) return Convert.ChangeType(text, field.FieldType, CultureInfo.InvariantCulture);
        var id = IdOf(text);
        return id == "0" ? null : made[id];
    }

    /// <summary>What Unity keeps of a component.</summary>
    public static IEnumerable<FieldInfo> Fields(Type type)
    {
        const BindingFlags any = BindingFlags.Instance | BindingFlags.Public | BindingFlags.NonPublic | BindingFlags.DeclaredOnly;
        return type.GetFields(any).Where(field => field.IsPublic && !field.IsInitOnly || field.GetCustomAttribute<SerializeField>() != null);
    }

    Type TypeOf(Part part)
    {
        if (part.Kind != "MonoBehaviour") return Engine[part.Kind];
        var script = assets[Reference.Match(part.One("m_Script")).Groups[2].Value];
        // Unity finds the class by the name of its file.
        var type = typeof(Kerf.Unity.KerfSession).Assembly.GetType("Kerf.Unity." + Path.GetFileNameWithoutExtension(script));
        Need(type != null && typeof(MonoBehaviour).IsAssignableFrom(type), script + " has no component of its name");
        return type;
    }

    static string IdOf(string text) => Reference.Match(text).Groups[1].Value;

    static float[] Numbers(Part part, string key)
    {
        return Regex.Matches(part.One(key), @"-?[\d.]+(?:e-?\d+)?").Cast<Match>().Select(number => float.Parse(number.Value, CultureInfo.InvariantCulture)).ToArray();
    }

    void Need(bool holds, string otherwise)
    {
        if (!holds) throw new Exception(path + ": " + otherwise);
    }
}
