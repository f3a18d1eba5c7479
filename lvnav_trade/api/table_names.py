"""Names of the tables of results, so that editors complete them and type checkers know them."""

import pandas as pd


class Frames:
    """Tables of results by name: one row per observation, units in the names of the columns.

    A table is read or computed on first use. ``lvnav-trade metrics`` lists the tables; the page Tables of the manual
    describes every column.
    """

    cases: pd.DataFrame  # one row per case: axes, errors, requirements, cost in SI (the computed table designs)
    # Stored tables
    designs: pd.DataFrame  # rows of many designs, as they are stored
    outputs: pd.DataFrame  # reported error components with their units
    runs: pd.DataFrame  # errors of every run at every event
    spot_runs: pd.DataFrame  # errors of the runs of the spot check
    traces: pd.DataFrame  # errors over time of the runs with the largest error of a requirement
    interval_errors: pd.DataFrame  # largest error and RMS error of every run between events
    mode_transitions: pd.DataFrame  # mode transitions of the filter in every run
    integrity: pd.DataFrame  # decisions of tests for faults, run by run
    nominal_integrity: pd.DataFrame  # decisions of tests for faults by linear covariance
    injections: pd.DataFrame  # orbit that every guided run achieves
    failed_injection_draws: pd.DataFrame  # vehicle dispersions of the runs that do not reach their cut-off
    injection_expected: pd.DataFrame  # achieved orbit by linear covariance: mean, sigma, knowledge and execution error
    injection_covariances: pd.DataFrame  # covariance of the achieved orbit by error source
    initial_draws: pd.DataFrame  # turn-on and initial-error draws of every run
    history: pd.DataFrame  # RMS, formal and true sigma of every error over time
    consistency: pd.DataFrame  # normalised estimation error squared over time
    innovations: pd.DataFrame  # normalised innovations squared over time, and rejected measurements
    whiteness: pd.DataFrame  # autocorrelation of innovations
    budget: pd.DataFrame  # error variance by source over time
    covariances: pd.DataFrame  # covariance of the navigation errors at the events
    states: pd.DataFrame  # true position, velocity and axes, at events and over time
    joint_covariances: pd.DataFrame  # covariance of velocity and position together, at events and over time
    adjoint: pd.DataFrame  # when each source causes the error at an event
    sensitivity: pd.DataFrame  # error with each source's sigma multiplied, filter re-tuned
    observability: pd.DataFrame  # singular values of the measurements by phase
    error_bound: pd.DataFrame  # bounds of process and measurement noise
    allan: pd.DataFrame  # Allan deviations of the inertial sensors
    protection: pd.DataFrame  # protection levels over time
    nonlinearity: pd.DataFrame  # nonlinearity index at the events
    satellites: pd.DataFrame  # satellites over time: azimuth, elevation, C/N0, tracking state
    transitions: pd.DataFrame  # changes of state of the tracking channels
    reference: pd.DataFrame  # true flight over time
    nozzle_travel: pd.DataFrame  # travel of the nozzle in every run, by burn
    nozzle_travel_history: pd.DataFrame  # travel of the nozzle over time
    motion_statistics: pd.DataFrame  # angular acceleration and jerk against their envelopes
    motion_history: pd.DataFrame  # angular acceleration and jerk of one run over time
    events: pd.DataFrame  # events of the flight: name, time
    # Computed tables
    requirements: pd.DataFrame  # verdict on every requirement in every case
    corridor: pd.DataFrame  # whether the instantaneous impact point stays in its corridor
    rms: pd.DataFrame  # errors by case, phase or event, quantity and axis
    control_variates: pd.DataFrame  # 3-D errors at injection, plain and with control variates
    ranking: pd.DataFrame  # 3-D errors of every case at injection, best velocity first
    coverage: pd.DataFrame  # share of runs within three sigma
    agreement: pd.DataFrame  # Monte Carlo RMS over linear covariance RMS
    contributions: pd.DataFrame  # contribution of each source to the 3-D errors
    observability_ranks: pd.DataFrame  # rank of the observability matrix
    filter_verdicts: pd.DataFrame  # whether the filter's covariance matches its errors
    effects: pd.DataFrame  # of many designs: how the error of each requirement follows each axis
    swings: pd.DataFrame  # of many designs: the error of each requirement at both ends of each axis
    regions: pd.DataFrame  # of many designs: share that meets each requirement, by part of each axis
    nees: pd.DataFrame  # normalised estimation error squared with its bounds
    nis: pd.DataFrame  # normalised innovation squared with its bounds
    autocorrelation: pd.DataFrame  # autocorrelation of each channel
    modes: pd.DataFrame  # share of runs in each mode over time
    stops: pd.DataFrame  # starts and stops of a filter with a mode logic
    decisions: pd.DataFrame  # what tests for faults decide, and when
    fault_test_errors: pd.DataFrame  # errors with and without tests for faults
    in_view: pd.DataFrame  # satellites tracked and above the horizon over time
    outages: pd.DataFrame  # 3-D errors around every fault
    tracking: pd.DataFrame  # availability of a position fix in each case
    losses: pd.DataFrame  # losses of tracking by reason
    recovery: pd.DataFrame  # loss and recovery of the receiver at every fault
    resource_totals: pd.DataFrame  # cost, mass, power and volume of every case
    pareto: pd.DataFrame  # cost and performance of every case
    assumptions: pd.DataFrame  # numbers that are marked as assumed
    configuration: pd.DataFrame  # key numbers of every case
    curves: pd.DataFrame  # error over each numeric axis
    crossings: pd.DataFrame  # where these curves cross the limit
    tornado: pd.DataFrame  # smallest and largest error over each axis
    expected_verdicts: pd.DataFrame  # verdicts by linear covariance
    spot_check: pd.DataFrame  # result of the spot check
    improvements: pd.DataFrame  # improvements that would meet a requirement
    margins: pd.DataFrame  # verdict and margin of every requirement
    windows: pd.DataFrame  # worst error around the event of a requirement
    unevaluated: pd.DataFrame  # requirements that results cannot be evaluated for, with the reason
    orbit: pd.DataFrame  # orbit at injection with its errors
    orbit_correction: pd.DataFrame  # delta-v that corrects the orbit
    normality: pd.DataFrame  # whether errors of the orbit are Gaussian
    injection: pd.DataFrame  # injection accuracy of guided ascents: achieved orbit against target
    injection_sources: pd.DataFrame  # budget of the achieved orbit: navigation and sources of the vehicle
    cutoff: pd.DataFrame  # how guided ascents end: depletion, time, propellant left
    failed_injections: pd.DataFrame  # guided runs without cut-off, with their largest vehicle dispersions
    impact: pd.DataFrame  # point of impact over the flight with its error
    exclusions: pd.DataFrame  # IMUs that are excluded by their test
    rate_and_acceleration: pd.DataFrame  # errors of rate and acceleration by phase
    rate_filter_benefit: pd.DataFrame  # benefit of the filtered angular rate for a controller
    references: pd.DataFrame  # published numbers next to the results
