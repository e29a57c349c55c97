"""The commands of `physid`: one typed function each, whose docstring is its help. Heavy imports stay inside."""

from physid.commands.benchmark import benchmark
from physid.commands.command import Command, format_help
from physid.commands.completion import completion, configs
from physid.commands.diagnoses import diagnose
from physid.commands.films import calibrate, track
from physid.commands.fits import fit, predict, sample, test, validate
from physid.commands.identifiability import identifiability
from physid.commands.imports import import_
from physid.commands.inspections import check, show
from physid.commands.overviews import dashboard, reproduce
from physid.commands.recordings import effects, generate

__all__ = ["COMMANDS", "Command", "format_help"]

COMMANDS: tuple[Command, ...] = (
    Command(generate, reads="physid.data.generation.settings.GenerateConfig"),
    Command(calibrate),
    Command(import_, reads="physid.data.importers.mapping.MappingKeys", laid="map"),
    Command(check),
    Command(show),
    Command(track),
    Command(fit, usual="sysid/base"),
    Command(validate),
    Command(test),
    Command(predict),
    Command(sample),
    Command(identifiability, reads="physid.training.identifiability.planned_experiment.IdentifiabilityConfig"),
    Command(diagnose, laid="set", settings="physid.diagnosis.settings.settings.Settings"),
    Command(benchmark),
    Command(effects),
    Command(configs),
    Command(reproduce),
    Command(dashboard),
    Command(completion),
)
