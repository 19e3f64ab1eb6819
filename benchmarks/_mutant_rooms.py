"""Which sources the mutants of a room are drawn from, and which tests speak of them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Part:
    """Sources by glob, and the quick tests that speak of them, the likeliest first: ten seconds or so."""

    sources: tuple[str, ...]
    tests: tuple[str, ...]


def _part(sources: str, tests: str, *more: str) -> Part:
    """Return a part: "bench/analysis/gap/_fit _cells" are two sources; tests are named alike."""
    return Part(
        tuple(f"{name}.py" for name in _in_folder(sources)),
        tuple(f"{name}.py" for words in (tests, *more) for name in _in_folder(words)),
    )


def _in_folder(words: str) -> list[str]:
    folder, _, names = words.rpartition("/")
    return [f"{folder}/{name}" for name in names.split()]


ROOMS: dict[str, tuple[Part, ...]] = {
    "safe": (
        _part(
            "bench/control/safe_state",
            "tests/safety/test_way_to_rest test_port_that_stays_away",
            "tests/control/test_session test_table_axes",
        ),
        _part(
            "bench/control/limits table_station ways",
            "tests/control/test_limits test_table_by_hand test_table_axes test_stations test_session",
        ),
        _part(
            "bench/control/watchdog/*",
            "tests/safety/test_takeover test_starved_runner test_replaced_terminal",
            "tests/safety/test_watchdogs_of_a_runner test_second_watchdog test_lease_after_the_runner",
            "tests/reliability/test_watchdog",
        ),
    ),
    "recording": (
        _part(
            "bench/record/recording/_timing",
            "tests/record/recording/test_timing_by_hand test_lateness_by_hand test_files_by_hand test_timing",
            "tests/record/recording/test_small_streams_by_hand test_reading test_decode",
            "tests/record/recording/test_recording_kvh",
        ),
        _part("bench/record/recording/_pulses", "tests/record/recording/test_pulses"),
        _part(
            "bench/record/recording/_remote", "tests/record/recording/test_files_by_hand test_object_storage"
        ),
        _part(
            "bench/record/recording/*",
            "tests/record/recording/test_journal test_events test_reading test_runs test_arrow test_decode",
            "tests/record/recording/test_reading_by_hand test_files_by_hand test_lateness_by_hand",
            "tests/record/recording/test_small_streams_by_hand test_pulses",
            "tests/record/test_signing test_failing_disk",
            "tests/integration/test_manifest_types",
            "tests/record/recording/test_recording_kvh test_recover test_journal_threads",
            "tests/reliability/test_power_cut",
            "tests/record/recording/test_object_storage",
        ),
    ),
    "decoders": (
        _part(
            "drivers/kvh/*",
            "tests/drivers/test_kvh_codec test_kvh_driver test_decoders_by_hand test_descriptions_by_hand",
            "tests/drivers/test_descriptions_whole",
        ),
        _part(
            "drivers/kit/slcan_codec",
            "tests/drivers/test_slcan_codec test_decoders_by_hand test_descriptions_by_hand test_slcan_bus",
        ),
        _part(
            "drivers/can_dbc/*",
            "tests/drivers/test_decoders_by_hand test_descriptions_by_hand",
            "tests/drivers/test_can_dbc_mapping test_can_dbc_decoder test_can_dbc_signals",
        ),
        _part(
            "drivers/frames/_line*",
            "tests/drivers/frames/test_frames_rules test_frames_by_hand test_printed_lines test_frames_lines",
            "tests/drivers/frames/test_frames_shipped test_line_reader test_fuzz",
            "tests/drivers/test_decoders_by_hand test_descriptions_by_hand test_descriptions_whole",
        ),
        _part(
            "drivers/kit/_candidates patterns splitting framing",
            "tests/drivers/frames/test_frames_split test_frames_rules test_frames_resync",
            "tests/drivers/test_framing test_kvh_codec test_slcan_codec test_decoders_by_hand",
        ),
        _part(
            "drivers/frames/_verify _vectors",
            "tests/drivers/frames/test_frames_rules test_frames_document test_frames_settings",
            "tests/drivers/frames/test_frames_lines test_frames_shipped test_frames_command",
            "tests/drivers/test_decoders_by_hand test_descriptions_by_hand test_descriptions_whole",
        ),
        _part(
            "drivers/frames/*",
            "tests/drivers/frames/test_frames_by_hand test_frames_rules test_frames_document test_printed_lines",
            "tests/drivers/frames/test_frames_resync",
            "tests/drivers/frames/test_frames_shipped",
            "tests/drivers/frames/test_frames_settings test_frames_lines test_fuzz",
            "tests/drivers/test_decoders_by_hand test_descriptions_by_hand test_descriptions_whole",
        ),
    ),
    "fits": (
        _part(
            "bench/analysis/common/allan*",
            "tests/analysis/common/test_allan test_allan_by_hand",
            "tests/analysis/figures/test_figures_by_hand test_figures_parts_by_hand test_figures_edges_by_hand",
        ),
        _part(
            "bench/analysis/thermal/_dataset",
            "tests/analysis/thermal/test_dataset test_scale_factor test_thermal_by_hand",
            "tests/analysis/thermal/test_thermal_choices_by_hand test_thermal_models_by_hand",
            "tests/analysis/thermal/test_thermal_edges_by_hand",
        ),
        _part(
            "bench/analysis/thermal/_grey_box _diffusion",
            "tests/analysis/thermal/test_grey_box test_thermal_by_hand",
            "tests/analysis/thermal/test_thermal_choices_by_hand test_thermal_models_by_hand",
            "tests/analysis/thermal/test_thermal_edges_by_hand",
        ),
        _part(
            "bench/analysis/thermal/_hybrid _sum",
            "tests/analysis/thermal/test_compensation test_hybrid test_thermal_by_hand",
            "tests/analysis/thermal/test_thermal_choices_by_hand test_thermal_models_by_hand",
            "tests/analysis/thermal/test_thermal_edges_by_hand",
        ),
        _part(
            "bench/analysis/thermal/_lstm*",
            "tests/analysis/thermal/test_lstm test_thermal_by_hand",
            "tests/analysis/thermal/test_thermal_choices_by_hand test_thermal_models_by_hand",
            "tests/analysis/thermal/test_thermal_edges_by_hand",
        ),
        _part(
            "bench/analysis/thermal/_scale_factor",
            "tests/analysis/thermal/test_scale_factor test_thermal_choices_by_hand test_thermal_models_by_hand",
            "tests/analysis/thermal/test_thermal_edges_by_hand",
        ),
        _part(
            "bench/analysis/common/stepwise",
            "tests/analysis/common/test_stepwise test_stepwise_by_hand test_strd",
        ),
        _part(
            "bench/analysis/thermal/*",
            "tests/analysis/thermal/test_thermal_choices_by_hand test_thermal_models_by_hand",
            "tests/analysis/thermal/test_evaluate test_features test_linear_models test_compensation",
            "tests/analysis/thermal/test_scale_factor test_grey_box test_thermal_by_hand test_leave_out",
            "tests/analysis/thermal/test_thermal_edges_by_hand test_thermal_study test_dataset",
            "tests/analysis/export/test_c_header",
        ),
        _part(
            "bench/analysis/rlg/_cycle",
            "tests/analysis/rlg/test_rlg_by_hand test_rlg_edges_by_hand test_rlg_cycle",
        ),
        _part(
            "bench/analysis/rlg/*",
            "tests/analysis/rlg/test_rlg_by_hand test_rlg_edges_by_hand",
            "tests/analysis/rlg/test_rlg_ramp test_rlg_report test_rlg_study test_rlg_profile",
            "tests/analysis/thermal/test_thermal_by_hand",
        ),
        _part(
            "bench/analysis/figures/*",
            "tests/analysis/figures/test_figures_by_hand test_figures_parts_by_hand test_standards test_budget",
            "tests/analysis/figures/test_figures_edges_by_hand test_of_procedure test_of_procedure_by_hand",
            "tests/analysis/figures/test_estimates test_standard_run",
        ),
    ),
    "gap": (
        _part(
            "bench/analysis/gap/_channel*",
            "tests/analysis/gap/test_gap_periods_by_hand test_gap_limits_by_hand",
            "tests/analysis/gap/test_gap_tables_by_hand test_gap_pieces_by_hand",
            "tests/analysis/gap/test_gap_channel_parts_by_hand test_gap_rows_by_hand test_gap_signals_by_hand",
            "tests/analysis/gap/test_gap_edges test_gap_corners_by_hand",
            "tests/analysis/gap/test_gap_by_hand test_gap_folders_by_hand test_gap_channels",
            "tests/analysis/gap/test_gap_modelled_channels test_gap_recording",
            "tests/analysis/gap/test_gap_one_diagnosis test_gap_platform test_gap_systems",
        ),
        _part(
            "bench/analysis/gap/_fast _fast_data _fast_floor _fast_lines _fast_spectrum _remarks",
            "tests/analysis/gap/test_gap_fast test_gap_aliases test_gap_short_logs",
        ),
        _part(
            "bench/analysis/gap/_position",
            "tests/analysis/gap/test_gap_periods_by_hand test_gap_limits_by_hand",
            "tests/analysis/gap/test_gap_tables_by_hand test_gap_pieces_by_hand",
            "tests/analysis/gap/test_gap_signals_by_hand test_gap_corners_by_hand test_gap_sets_by_hand",
            "tests/analysis/gap/test_gap_platform",
            "tests/analysis/gap/test_gap_one_diagnosis",
        ),
        _part(
            "bench/analysis/gap/_import _log_rows _other_axes _run_folder _data _model_file _recordings",
            "tests/analysis/gap/test_gap_periods_by_hand test_gap_limits_by_hand",
            "tests/analysis/gap/test_gap_tables_by_hand test_gap_pieces_by_hand",
            "tests/analysis/gap/test_gap_rows_by_hand test_gap_closing_by_hand test_gap_signals_by_hand",
            "tests/analysis/gap/test_gap_maps_by_hand test_gap_corners_by_hand test_gap_edges test_gap_by_hand",
            "tests/analysis/gap/test_gap_folders_by_hand test_gap_cells test_gap_import",
            "tests/analysis/gap/test_gap_odd_logs test_gap_systems test_gap_diagnosis test_gap_commands",
        ),
        _part(
            "bench/analysis/gap/_rehearsal _response _suggest _series",
            "tests/analysis/gap/test_gap_periods_by_hand test_gap_limits_by_hand",
            "tests/analysis/gap/test_gap_tables_by_hand test_gap_pieces_by_hand",
            "tests/analysis/gap/test_gap_closing_by_hand test_gap_curves_by_hand test_gap_edges test_gap_by_hand",
            "tests/analysis/gap/test_gap_folders_by_hand test_gap_sets_by_hand test_gap_rehearsal",
            "tests/analysis/gap/test_gap_platform test_gap_corners_by_hand",
        ),
        _part(
            "bench/analysis/gap/_information _identify _outlook _columns _designs _simulation",
            "tests/analysis/gap/test_gap_periods_by_hand test_gap_limits_by_hand",
            "tests/analysis/gap/test_gap_tables_by_hand test_gap_pieces_by_hand",
            "tests/analysis/gap/test_gap_curves_by_hand test_gap_closing_by_hand test_gap_maps_by_hand",
            "tests/analysis/gap/test_gap_corners_by_hand",
            "tests/analysis/gap/test_gap_folders_by_hand test_gap_sets_by_hand test_gap_edges",
            "tests/analysis/gap/test_gap_information test_gap_identify test_gap_outlook test_gap_simulation",
        ),
        _part(
            "bench/analysis/gap/_disturbed _align",
            "tests/analysis/gap/test_gap_periods_by_hand test_gap_limits_by_hand",
            "tests/analysis/gap/test_gap_tables_by_hand test_gap_pieces_by_hand",
            "tests/analysis/gap/test_gap_closing_by_hand test_gap_spectra_by_hand test_gap_record_effects",
            "tests/analysis/gap/test_gap_diagnosis test_gap_clock_offset",
        ),
        _part(
            "bench/analysis/gap/_exam _examination _score _exam_folder _case_folder _signature",
            "tests/analysis/gap/test_gap_periods_by_hand test_gap_limits_by_hand",
            "tests/analysis/gap/test_gap_tables_by_hand test_gap_pieces_by_hand",
            "tests/analysis/gap/test_gap_closing_by_hand test_gap_edges test_gap_by_hand",
            "tests/analysis/gap/test_gap_spectra_by_hand test_gap_folders_by_hand test_gap_sets_by_hand",
            "tests/analysis/gap/test_gap_corners_by_hand test_gap_fit test_gap_exam",
        ),
        _part(
            "bench/analysis/gap/*",
            "tests/analysis/gap/test_gap_periods_by_hand test_gap_limits_by_hand",
            "tests/analysis/gap/test_gap_tables_by_hand test_gap_pieces_by_hand",
            "tests/analysis/gap/test_gap_judgements_by_hand test_gap_verdicts_by_hand test_gap_curves_by_hand",
            "tests/analysis/gap/test_gap_closing_by_hand test_gap_rows_by_hand test_gap_signals_by_hand",
            "tests/analysis/gap/test_gap_maps_by_hand test_gap_corners_by_hand",
            "tests/analysis/gap/test_gap_edges test_gap_by_hand test_gap_spectra_by_hand",
            "tests/analysis/gap/test_gap_folders_by_hand test_gap_sets_by_hand test_gap_fit test_gap_cells",
            "tests/analysis/gap/test_gap_close test_gap_doubt test_gap_learn test_gap_aliases",
            "tests/analysis/gap/test_gap_lines test_gap_refine test_gap_noise test_gap_grams",
            "tests/analysis/gap/test_gap_second_look",
            "tests/analysis/gap/test_gap_diagnosis test_gap_one_diagnosis test_gap_recording test_gap_systems",
            "tests/analysis/gap/test_gap_record_effects test_gap_channels test_gap_effects test_gap_rehearsal",
            "tests/analysis/gap/test_gap_modelled_unit",
            "tests/analysis/gap/test_gap_bridge test_gap_missing_fmu test_gap_form test_gap_shaken",
            "tests/analysis/gap/test_gap_batch test_gap_every_repeat",
        ),
    ),
}
"""A file belongs to the first part of its room that names it."""
