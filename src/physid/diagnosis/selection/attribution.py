"""Which effect: contact-free segments are searched first, then all; what was found is fitted to all frames."""

from __future__ import annotations

import torch

from physid.diagnosis.progress import Progress, silent
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.all_frames import fit_all_frames
from physid.diagnosis.selection.contact_free import contact_free
from physid.diagnosis.selection.further import further_effects
from physid.diagnosis.selection.materiality import is_material
from physid.diagnosis.selection.search import Attribution, leaves_nothing, search_catalogue, unexplained


def attribute(nominal_fit: NominalFit, generator: torch.Generator, say: Progress = silent) -> Attribution:
    """Search the catalogue for what the nominal model lacks: first where the motion is calm, then everywhere.

    Contact-free segments decide alone where they show a material gap and all of its cause, or a gap that nothing
    explains, which impacts will not explain either. A part of a cause there, and one too small to matter, may be the
    faint side of what acts at impacts: then all segments decide, if what they find leaves nothing.

    Args:
        nominal_fit: The fitted nominal model.
        generator: Randomness of null simulations.
        say: Called with what is being done.
    """
    first = nominal_fit.settings.contact_free.first
    quiet = contact_free(nominal_fit, generator, say) if first else None
    if quiet is None:
        return search_catalogue(nominal_fit, generator, say)
    calm = search_catalogue(quiet, generator, say)
    material = is_material(nominal_fit, calm.nominal, calm.lack)
    if not material or not (leaves_nothing(calm) or unexplained(calm)):
        found = search_catalogue(nominal_fit, generator, say)
        if calm.best is None or leaves_nothing(found):
            return found
    return further_effects(nominal_fit, fit_all_frames(nominal_fit, calm, say), generator, say)
