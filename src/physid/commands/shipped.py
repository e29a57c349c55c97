"""The command that lists, shows and copies the configurations that come with physid."""

from __future__ import annotations

from pathlib import Path


def configs(name: str | None = None, *, out: Path | None = None) -> None:
    """List, show or copy the configurations that come with physid.

    Without a name all are listed. Every command that takes --config takes such a name as well as a file, and single
    values are changed on the command line; a copy is for more than that. It brings along what the file builds on.

    Examples:
      physid configs
      physid configs sysid/push_friction
      physid configs sysid/push_friction --out mine
      physid fit --config mine/sysid/push_friction.yaml

    Args:
        name: One of them, or a folder of them such as sysid; all by default.
        out: Folder to copy to, instead of showing; what lies there already is left.
    """
    from physid.configuration import ConfigurationError
    from physid.data.files import write_text
    from physid.shipped import SHIPPED, SUFFIX, names, summary, with_bases
    from physid.strict import nearest

    known = names()
    asked = (name or "").removeprefix("configs/").removesuffix(SUFFIX).strip("/")
    chosen = [each for each in known if not asked or each == asked or each.startswith(f"{asked}/")]
    if not chosen:
        raise ConfigurationError(f'configs: there is no "{name}"{nearest(asked, known)}; physid configs lists them')
    if out is None and chosen == [asked]:
        print((SHIPPED / f"{asked}{SUFFIX}").read_text(), end="")
        return
    if out is None:
        width = max(map(len, chosen))
        print("\n".join(f"{each:<{width}}  {summary(each)}" for each in chosen))
        return
    for each in dict.fromkeys(base for one in chosen for base in with_bases(one)):
        target = out / f"{each}{SUFFIX}"
        if target.exists():
            print(f"{target} is there already, and is left")
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        write_text(target, (SHIPPED / f"{each}{SUFFIX}").read_text())
        print(target)
