//! What clients call: the methods of `ResultManagement`.

use std::sync::Arc;

use opcua::server::node_manager::memory::SimpleNodeManager;
use opcua::types::{DataTypeId, ExtensionObject, NodeId, StatusCode, UAString, Variant, VariantScalarTypeId};

use crate::shown::verdict::CasingVerdict;
use crate::wires::opcua::names::{Namespaces, id};
use crate::wires::opcua::nodes::add_method;
use crate::wires::opcua::result::result;
use crate::wires::outbox::Receiver;
use crate::wires::wire::Plant;

/// Errors that methods return, below 0 as those of an application must be.
const UNKNOWN: i32 = -1;
const NOT_SUPPORTED: i32 = -2;

/// Most identifiers in one answer.
const LISTED_MAX: usize = 1000;

/// Most identifiers in one request.
const ACKNOWLEDGED_MAX: usize = 10_000;

/// What a method returns.
type Answer = Result<Vec<Variant>, StatusCode>;

/// Adds the methods to `line`.
pub(super) fn add(line: &SimpleNodeManager, ns: Namespaces, plant: &Plant) {
    let one = |name: &'static str, data_type: DataTypeId| (name, NodeId::from(data_type), false);
    let (text, number) = (DataTypeId::TrimmedString, DataTypeId::Int32);
    let handle = one("ResultHandle", DataTypeId::Handle);
    let (timeout, error) = (one("Timeout", number), one("Error", number));
    let results = [handle.clone(), ("Result", ns.of_result(id::RESULT_DATA), false), error.clone()];
    let method = |name, input: &[_], output: &[_], call: fn(&Plant, &[Variant]) -> Answer| {
        let node = add_method(&mut *line.address_space().write(), ns, name, input, output);
        let plant = plant.clone();
        line.inner().add_method_callback(node, move |arguments| call(&plant, arguments));
    };
    method("GetResultById", &[one("ResultId", text), timeout.clone()], &results, result_by_id);
    method("GetLatestResult", std::slice::from_ref(&timeout), &results, |plant, _| {
        Ok(answer(plant.now.latest().as_deref()))
    });
    let list = |name: &'static str, data_type: DataTypeId| (name, NodeId::from(data_type), true);
    let asked = [
        one("Filter", DataTypeId::ContentFilter),
        list("OrderedBy", DataTypeId::RelativePath),
        one("MaxResults", DataTypeId::UInt32),
        timeout,
    ];
    method("GetResultIdListFiltered", &asked, &[handle, list("ResultIdList", text), error.clone()], waiting_ids);
    let errors = [list("ErrorPerResultId", number), error.clone()];
    method("AcknowledgeResults", &[list("ResultIds", text)], &errors, acknowledge);
    // A handle holds nothing here.
    let released = [one("ResultHandle", DataTypeId::Handle)];
    method("ReleaseResultHandle", &released, &[error], |_, _| Ok(vec![0_i32.into()]));
}

/// The answer with the result of a verdict, or without one.
fn answer(verdict: Option<&CasingVerdict>) -> Vec<Variant> {
    match verdict {
        Some(verdict) => vec![0_u32.into(), result(verdict), 0_i32.into()],
        None => vec![0_u32.into(), ExtensionObject::null().into(), UNKNOWN.into()],
    }
}

/// A verdict that waits to be acknowledged, or the latest one.
fn result_by_id(plant: &Plant, arguments: &[Variant]) -> Answer {
    let [Variant::String(id), ..] = arguments else { return Err(StatusCode::BadInvalidArgument) };
    let waiting = number_of(id).and_then(|number| plant.outbox.find(Receiver::OpcUa, number));
    let verdict = match waiting {
        Some(note) => plant.outbox.read(&note),
        None => plant.now.latest().filter(|latest| latest.id == id.as_ref()),
    };
    Ok(answer(verdict.as_deref()))
}

/// The identifiers of verdicts that wait to be acknowledged, the oldest first. Only a maximum number can be asked for.
fn waiting_ids(plant: &Plant, arguments: &[Variant]) -> Answer {
    let [filter, order, most, ..] = arguments else { return Err(StatusCode::BadArgumentsMissing) };
    let answer = |ids: Vec<String>, error: i32| {
        let ids: Vec<UAString> = ids.into_iter().map(UAString::from).collect();
        Ok(vec![0_u32.into(), ids.into(), error.into()])
    };
    if !is_empty_filter(filter) || !is_empty_list(order) {
        return answer(Vec::new(), NOT_SUPPORTED);
    }
    let most = match most {
        Variant::UInt32(0) => LISTED_MAX,
        Variant::UInt32(most) => LISTED_MAX.min(*most as usize),
        _ => return Err(StatusCode::BadInvalidArgument),
    };
    answer(plant.outbox.ids(Receiver::OpcUa, most), 0)
}

fn is_empty_list(list: &Variant) -> bool {
    match list {
        Variant::Empty => true,
        Variant::Array(list) => list.values.is_empty(),
        _ => false,
    }
}

fn is_empty_filter(filter: &Variant) -> bool {
    match filter {
        Variant::Empty => true,
        Variant::ExtensionObject(object) => {
            let filter = object.inner_as::<opcua::types::ContentFilter>();
            object.is_null() || filter.is_some_and(|filter| filter.elements.as_ref().is_none_or(Vec::is_empty))
        }
        _ => false,
    }
}

/// Notes that the plant has the verdicts with these identifiers.
fn acknowledge(plant: &Plant, arguments: &[Variant]) -> Answer {
    let ids: Vec<&UAString> = match arguments {
        [Variant::Array(list)] if list.value_type == VariantScalarTypeId::String => {
            list.values.iter().filter_map(|id| if let Variant::String(id) = id { Some(id) } else { None }).collect()
        }
        [Variant::Empty] => Vec::new(),
        _ => return Err(StatusCode::BadInvalidArgument),
    };
    if ids.len() > ACKNOWLEDGED_MAX {
        return Err(StatusCode::BadTooManyOperations);
    }
    let outbox = Arc::clone(&plant.outbox);
    let is_acknowledged =
        |id: &&UAString| number_of(id).is_some_and(|number| outbox.acknowledge(Receiver::OpcUa, number));
    let errors: Vec<i32> = ids.iter().map(|id| if is_acknowledged(id) { 0 } else { UNKNOWN }).collect();
    match errors.iter().find(|&&error| error != 0) {
        None => Ok(vec![Vec::<i32>::new().into(), 0_i32.into()]),
        Some(&error) => Ok(vec![errors.into(), error.into()]),
    }
}

/// The casing's number in an identifier.
fn number_of(id: &UAString) -> Option<u64> {
    u64::from_str_radix(id.as_ref(), 16).ok()
}
