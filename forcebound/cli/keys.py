"""Commands that create and show the keys of links to other machines."""

from dataclasses import asdict

import click

from forcebound.cli.common import Group, json_option, print_json, reports_errors, show


@click.group("keys", cls=Group)
def keys_group() -> None:
    """Create and show the keys for a link to another machine."""


@keys_group.command("new")
@click.argument("name")
@json_option
@reports_errors
def new_keys(name: str, as_json: bool) -> None:
    r"""Create the key pair NAME; the secret stays on this machine.

    \b
    forcebound keys new lab_pc
    """
    from forcebound.network.keys import key_folder, new_key

    made, folder = new_key(name), key_folder()
    if as_json:
        print_json({"name": made.name, "public": made.public, "folder": str(folder)})
        return
    show(f"public key: {made.public}")
    show(f"copy {folder / name}.key to the other machine's key folder; the secret stays here")


@keys_group.command("list")
@json_option
@reports_errors
def list_all_keys(as_json: bool) -> None:
    r"""List the keys on this machine.

    \b
    forcebound keys list --json
    """
    from forcebound.network.keys import key_folder, list_keys

    entries = list_keys()
    if as_json:
        print_json([asdict(entry) for entry in entries])
        return
    for entry in entries:
        kind = "pair" if entry.has_secret else "public"
        problem = f"{entry.problem}: {entry.action}" if entry.action else entry.problem
        show(f"{entry.name:<20}{kind:<8}{problem or entry.public}")
    if not entries:
        show(f"no keys in {key_folder()}; create one with `forcebound keys new NAME`", err=True)


@keys_group.command("show")
@click.argument("name")
@json_option
@reports_errors
def show_key(name: str, as_json: bool) -> None:
    r"""Print the public key NAME, for the other machine.

    \b
    forcebound keys show lab_pc
    """
    from forcebound.network.keys import public_key

    public = public_key(name)
    print_json({"name": name, "public": public}) if as_json else show(public)
