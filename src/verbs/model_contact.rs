//! `tapline model contact`: one contact on a rung of the ladder of models.

use std::io::Write;

use anyhow::{Result, anyhow};
use serde_json::{Value, json};
use tapline_host::stdout::Stdout;
use tapline_model::{Contact, Error, Scene, choose_by_trial};

use crate::cli::model::ContactArgs;

pub(crate) fn contact(args: &ContactArgs) -> Result<bool> {
    let scene = args.scene();
    let named = |error| args.in_its_own_words(error);
    let (contact, more) = match args.rung {
        Some(rung) => (rung.contact(&scene, args.damping).map_err(named)?, Vec::new()),
        None => {
            let choice = choose_by_trial(&scene, args.damping, args.tolerance).map_err(named)?;
            let error = choice.errors.of(choice.contact.rung);
            let more = vec![
                ("tolerance", json!(choice.tolerance)),
                ("error", json!(error)),
                ("why", json!(choice.to_string())),
            ];
            (choice.contact, more)
        }
    };
    print(&contact, more, args.json)?;
    Ok(true)
}

impl ContactArgs {
    fn scene(&self) -> Scene {
        Scene {
            velocity_m_per_s: self.velocity_m_per_s,
            m_1_kg: self.mass_g * 1e-3,
            m_2_kg: self.target_mass_kg,
            e_2_pa: self.e2_mpa * 1e6,
            h_m: self.depth_mm * 1e-3,
            l_m: self.length_mm * 1e-3,
            w_m: self.width_mm * 1e-3,
            restitution: self.restitution,
            resilience: self.resilience,
            effective_length: self.effective_length,
            ..Scene::default()
        }
    }

    /// The error with the option that was given in place of the quantity that it became.
    fn in_its_own_words(&self, error: Error) -> anyhow::Error {
        let Error::OutOfRange { name, low, high, .. } = error else { return error.into() };
        let (option, value, per_unit) = match name {
            "velocity_m_per_s" => ("--velocity-m-per-s", self.velocity_m_per_s, 1.0),
            "m_1_kg" => ("--mass-g", self.mass_g, 1e3),
            "m_2_kg" => ("--target-mass-kg", self.target_mass_kg, 1.0),
            "e_2_pa" => ("--e2-mpa", self.e2_mpa, 1e-6),
            "h_m" => ("--depth-mm", self.depth_mm, 1e3),
            "l_m" => ("--length-mm", self.length_mm, 1e3),
            "w_m" => ("--width-mm", self.width_mm, 1e3),
            "restitution" => ("--restitution", self.restitution, 1.0),
            "resilience" => ("--resilience", self.resilience, 1.0),
            "tolerance" => ("--tolerance", self.tolerance, 1.0),
            _ => return error.into(),
        };
        let (low, high) = (bound(low * per_unit), bound(high * per_unit));
        anyhow!("{option} is {value}; it must lie in {low} to {high}")
    }
}

/// A bound without a row of zeros.
fn bound(value: f64) -> String {
    if value == 0.0 || (1e-3..1e6).contains(&value.abs()) { value.to_string() } else { format!("{value:.0e}") }
}

fn print(contact: &Contact, more: Vec<(&str, Value)>, as_json: bool) -> Result<()> {
    let mut out = Stdout;
    if as_json {
        let flag =
            |c: &tapline_model::DomainCheck| json!({"name": c.name, "value": c.value, "low": c.low, "high": c.high});
        let mut text = json!({
            "rung": contact.rung.name(),
            "f_max_n": contact.f_max_n,
            "contact_time_s": contact.contact_time_s,
            "d_max_m": contact.d_max_m,
            "restitution": contact.restitution,
            "flags": contact.flags.raised().map(flag).collect::<Vec<_>>(),
        });
        for (name, value) in more {
            text[name] = value;
        }
        writeln!(out, "{text}")?;
        return Ok(());
    }
    writeln!(out, "rung            {}", contact.rung)?;
    writeln!(out, "f_max_n         {:.6}", contact.f_max_n)?;
    writeln!(out, "contact_time_s  {:.9}", contact.contact_time_s)?;
    writeln!(out, "d_max_m         {:.9}", contact.d_max_m)?;
    writeln!(out, "restitution     {:.6}", contact.restitution)?;
    for check in contact.flags.raised() {
        let (low, high) = (bound(check.low), bound(check.high));
        writeln!(out, "flag            {} is {:.4}, outside {low} to {high}", check.name, check.value)?;
    }
    for (name, value) in more {
        writeln!(out, "{name:<15} {}", value.as_str().map_or_else(|| value.to_string(), str::to_owned))?;
    }
    Ok(())
}
