//! Namespaces and identifiers: those of OPC 40001-101, and the line's own.

use opcua::types::NodeId;

/// The namespace of results, as OPC 40001-101 has it.
pub(super) const RESULT_NAMESPACE: &str = "http://opcfoundation.org/UA/Machinery/Result/";

/// The namespace of the line's own nodes.
pub(super) const LINE_NAMESPACE: &str = "urn:tapline:line";

/// Identifiers in the namespace of results.
pub(super) mod id {
    pub(crate) const RESULT_READY_EVENT: u32 = 1002;
    pub(crate) const RESULT_MANAGEMENT: u32 = 1004;
    pub(crate) const RESULT: u32 = 2001;
    pub(crate) const RESULT_EVALUATION: u32 = 3002;
    pub(crate) const RESULT_META_DATA: u32 = 3007;
    pub(crate) const RESULT_DATA: u32 = 3008;
    pub(crate) const RESULT_META_DATA_BINARY: u32 = 5005;
    pub(crate) const RESULT_DATA_BINARY: u32 = 5008;
    pub(crate) const RESULT_EVALUATION_STRINGS: u32 = 6001;
    pub(crate) const RESULT_OF_EVENT: u32 = 6032;
}

/// Indices of the namespaces at a server.
#[derive(Debug, Clone, Copy)]
pub(super) struct Namespaces {
    pub result: u16,
    pub line: u16,
}

impl Namespaces {
    /// A node of OPC 40001-101.
    pub(super) fn of_result(self, id: u32) -> NodeId {
        NodeId::new(self.result, id)
    }

    /// A node of the line.
    pub(super) fn of_line(self, name: &str) -> NodeId {
        NodeId::new(self.line, name.to_owned())
    }

    /// What is read of a station.
    pub(super) fn of_station(self, station: u16, name: &str) -> NodeId {
        self.of_line(&format!("station/{station}/{name}"))
    }
}
