//! The interaction solver against closed forms, others' results, independent programs, and what symmetry demands.
//!
//! Closed forms come from simply supported uniform beams other than girder50; each is built here as a bridge file and
//! reduced by the same program as any bridge.

mod beams;
mod demands;
mod independent;
mod limits;
mod published;

use std::borrow::Borrow;
use std::f64::consts::PI;
use std::path::PathBuf;

use host_sim::model;
use host_sim::validate::beam::{Beam, GIRDER50};
use spanwatch::bridge::{Damage, ModalBridge, ReducedBridge};
use spanwatch::capacity::{BASIS, CAR_DOFS, CONTACTS, ELEMENTS, MODES};
use spanwatch::interaction::{Kinematics, Modes, PlanarInteraction, Run, Scheme, SetupError, TrainSteps};
use spanwatch::math::Real;
use spanwatch::recorder::{AntiAlias, AntiAliasState};
use spanwatch::track::Smooth;
use spanwatch::train::{Car, Contact, GRAVITY_MPS2, Motion, PlanarTrain, Spring, Train};
use spanwatch::wire::message::TrainKind;

use beams::*;
