"""Validates the manifests of the folders beside it: lint.py, with kubernetes-validate installed.

Each folder has a kustomization.yaml. Every file in it has to be listed there. Patches are merged into what they patch, as
Kustomize does it for containers, variables and mounts, and the result is validated. Kinds that clusters are extended by
have no schema in the package, and are listed here.
"""

import sys
from pathlib import Path

import kubernetes_validate
import yaml

FOLDER = Path(__file__).parent
EXTENSIONS = {"gateway.networking.k8s.io", "agones.dev", "autoscaling.agones.dev", "allocation.agones.dev"}
NAMED = ("mountPath", "name")


def read(path):
    """The documents of a file."""
    return [document for document in yaml.safe_load_all(path.read_text(encoding="utf-8")) if document]


def merged(base, patch):
    """A strategic merge: entries of lists go together by their name."""
    if isinstance(base, dict) and isinstance(patch, dict):
        return base | {key: merged(base[key], value) if key in base else value for key, value in patch.items()}
    if not isinstance(base, list) or not all(isinstance(entry, dict) for entry in [*base, *patch]):
        return patch
    key = next((name for name in NAMED if all(name in entry for entry in [*base, *patch])), None)
    if key is None:
        return patch
    entries = {entry[key]: entry for entry in base}
    for entry in patch:
        entries[entry[key]] = merged(entries.get(entry[key], {}), entry)
    return list(entries.values())


def identity(document):
    return document["kind"], document["metadata"]["name"]


def built(folder):
    """The manifests of a folder by kind and name, with those that it builds on."""
    kustomization = read(folder / "kustomization.yaml")[0]
    manifests = {}
    for resource in kustomization["resources"]:
        path = folder / resource
        found = built(path.resolve()) if path.is_dir() else {identity(each): each for each in read(path)}
        manifests |= found
    for patch in kustomization.get("patches", []):
        for document in read(folder / patch["path"]):
            manifests[identity(document)] = merged(manifests[identity(document)], document)
    return manifests


def unlisted(folder):
    kustomization = read(folder / "kustomization.yaml")[0]
    patches = (patch["path"] for patch in kustomization.get("patches", []))
    listed = {*kustomization["resources"], *patches, *kustomization.get("configurations", [])}
    return sorted({path.name for path in folder.glob("*.yaml")} - listed - {"kustomization.yaml"})


def faults(folder):
    """What is wrong with a folder."""
    yield from (f"{name} is not in kustomization.yaml" for name in unlisted(folder))
    for manifest in built(folder).values():
        if manifest["apiVersion"].split("/")[0] in EXTENSIONS:
            continue
        try:
            kubernetes_validate.validate(manifest, kubernetes_validate.latest_version(), strict=True)
        except (kubernetes_validate.ValidationError, kubernetes_validate.SchemaNotFoundError) as error:
            # The rest of the text is the schema.
            at = ".".join(map(str, getattr(error, "path", [])))
            yield f"{' '.join(identity(manifest))}: {at}: {getattr(error, 'message', error)}"


def main():
    folders = sorted(path.parent for path in FOLDER.glob("*/kustomization.yaml"))
    found = [f"{folder.name}: {fault}" for folder in folders for fault in faults(folder)]
    if found or not folders:
        sys.exit("\n".join(found) or "no folder has a kustomization.yaml")


if __name__ == "__main__":
    main()
