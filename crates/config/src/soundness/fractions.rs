//! Finds limits in percent on a fraction: such a value never reaches 20.

use super::{Finding, FindingKind};
use crate::expression;
use telltale_engine::model::monitors::{Bands, ValueRule, ValueSource};
use telltale_engine::model::quantity::Quantity;
use telltale_engine::model::sample::FieldValue;
use telltale_engine::model::{GroupId, Model, ModuleId, MonitorSpec, NodeId};

pub(super) fn look(model: &Model) -> Vec<Finding> {
    let modules = model.modules.iter().zip((0..).map(ModuleId)).filter_map(|(module, id)| {
        let (field, limit) = percent(model, module.monitor.other()?)?;
        let what = FindingKind::PercentLimit { signal: None, field, limit };
        Some(Finding { node: NodeId::Module(id), what, example: None })
    });
    let signals = model.signals.iter().enumerate().filter_map(|(index, signal)| {
        let (field, limit) = percent(model, signal.source.condition()?)?;
        let what = FindingKind::PercentLimit { signal: Some(index), field, limit };
        Some(Finding { node: NodeId::Group(GroupId(0)), what, example: None })
    });
    modules.chain(signals).collect()
}

/// The first limit of a monitor beyond the range of its field, and that field.
fn percent(model: &Model, monitor: &MonitorSpec) -> Option<(Box<str>, f64)> {
    let first = |sources: &[&ValueSource], limits: &[f64]| {
        let field = sources.iter().find_map(|source| fraction(model, source))?;
        Some((field.into(), limits.iter().copied().find(|limit| limit.abs() > 1.0)?))
    };
    match monitor {
        MonitorSpec::Value { source, rule: ValueRule::Unless { error, warning }, .. } => {
            let number = |value: &FieldValue| match value {
                FieldValue::Number(value) => Some(*value),
                _ => None,
            };
            let wanted: Vec<f64> = [error, warning].into_iter().flatten().filter_map(number).collect();
            first(&[source], &wanted)
        }
        MonitorSpec::Expression { inputs, warning, error, .. } => {
            let written = [error, warning].into_iter().flatten().flat_map(expression::limits);
            let mut written = written.filter_map(|limit| {
                let (_, source) = inputs.iter().find(|(name, _)| **name == *limit.input)?;
                first(&[source], &[limit.number])
            });
            written.next()
        }
        other => {
            let (sources, bands) = other.measured();
            first(&sources, &bands.map(limits).unwrap_or_default())
        }
    }
}

fn limits(bands: &Bands) -> Vec<f64> {
    let Bands { warning_below, error_below, warning_above, error_above, unmeasurable: _ } = *bands;
    [warning_below, error_below, warning_above, error_above].into_iter().flatten().collect()
}

fn fraction<'m>(model: &'m Model, source: &ValueSource) -> Option<&'m str> {
    let ValueSource::Field { topic, field } = source else { return None };
    let topic = &model.watched.topics[topic.0 as usize];
    let path = &topic.fields[*field as usize].path;
    Quantity::of(source, &model.watched)?.is_fraction().then_some(&**path)
}
